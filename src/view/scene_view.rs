use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::{Duration, Instant};

use wgpu::util::DeviceExt;

use super::content::{Content, Model};
use super::mesh_raster::AMBIENT;
use super::pipelines::Pipelines;
use super::points::EyeUniform;
use super::target::Target;
use super::{Coloring, Line, ViewCamera};
use crate::masks::{LabelId, LabelTree};

/// What one call of [`SceneView::draw`] may cost before the batch shrinks.
const FRAME_BUDGET: Duration = Duration::from_millis(40);

/// All that decides what the 3-D view shows; a change of anything starts the picture anew.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene3d {
    /// Where it is seen from; its size is the texture's size.
    pub camera: ViewCamera,
    /// What point colours show.
    pub coloring: Coloring,
    /// Labels (with all below them) that are not drawn.
    pub hidden: BTreeSet<LabelId>,
    /// Names and colours newer than the cloud's own.
    pub tree: Option<LabelTree>,
    /// Smallest disc radius in pixels, above 0.
    pub point_px: f32,
    /// sRGB.
    pub background: [u8; 3],
    /// Line segments, e.g. [`super::frustum_lines`].
    pub lines: Vec<Line>,
}

/// Draws a cloud or a surface of any size into a texture of its own, a bounded batch of points or triangles per call: a
/// part that is spread over the whole at once while the camera moves, all of it within some calls when it rests.
pub struct SceneView {
    device: wgpu::Device,
    queue: wgpu::Queue,
    pipelines: Pipelines,
    content: Content,
    drawn: usize,
    batch: usize,
    scene: Option<Scene3d>,
    target: Option<Target>,
    last_draw: Option<Instant>,
}

impl SceneView {
    /// A view without points. The texture's format is `Rgba8Unorm`, holding sRGB values.
    #[must_use]
    pub fn new(device: &wgpu::Device, queue: &wgpu::Queue) -> Self {
        Self {
            device: device.clone(),
            queue: queue.clone(),
            pipelines: Pipelines::new(device),
            content: Content::new(Model::Cloud(Arc::default())),
            drawn: 0,
            batch: 200_000,
            scene: None,
            target: None,
            last_draw: None,
        }
    }

    /// Shows another model from the next draw on; does nothing when it is the one shown.
    pub fn set_model(&mut self, model: Model) {
        if !self.content.shows(&model) {
            self.content = Content::new(model);
            self.drawn = 0;
        }
    }

    /// Draws the next batch. Returns whether the picture is whole; call again (next frame) while it is not.
    pub fn draw(&mut self, scene: &Scene3d) -> bool {
        let fresh = self.take_over(scene);
        if !fresh && self.drawn == self.content.len {
            self.last_draw = None;
            return true;
        }
        self.adapt_batch();
        if self.content.uploaded < self.content.len.min(self.drawn + self.batch) {
            self.content.upload_next(&self.device, scene);
        }
        self.draw_next(fresh, scene);
        self.drawn == self.content.len
    }

    /// The texture drawn into (a new one when the scene's camera has another size); `None` before the first draw.
    #[must_use]
    pub fn texture(&self) -> Option<&wgpu::TextureView> {
        self.target.as_ref().map(|target| &target.color)
    }

    /// Points or triangles drawn of the picture as it stands, and all that there are.
    #[must_use]
    pub fn drawn(&self) -> (usize, usize) {
        (self.drawn, self.content.len)
    }

    /// Takes over what changed; returns whether the picture starts anew.
    fn take_over(&mut self, scene: &Scene3d) -> bool {
        if self.scene.as_ref() == Some(scene) {
            return self.drawn == 0 && self.content.uploaded == 0;
        }
        let recolored = self
            .scene
            .as_ref()
            .is_none_or(|old| old.coloring != scene.coloring || old.hidden != scene.hidden || old.tree != scene.tree);
        if recolored {
            self.content.forget();
        }
        let size = (scene.camera.width.max(1), scene.camera.height.max(1));
        if self.target.as_ref().is_none_or(|target| target.size != size) {
            self.target = Some(Target::new(&self.device, size));
        }
        self.drawn = 0;
        self.scene = Some(scene.clone());
        true
    }

    /// Fewer points or triangles per call when calls are slow, more when they are quick.
    fn adapt_batch(&mut self) {
        if let Some(last) = self.last_draw.replace(Instant::now()) {
            let took = last.elapsed();
            if took > FRAME_BUDGET * 3 / 2 {
                self.batch = (self.batch / 2).max(50_000);
            } else if took < FRAME_BUDGET / 2 {
                self.batch = (self.batch * 3 / 2).min(4_000_000);
            }
        }
    }

    fn draw_next(&mut self, fresh: bool, scene: &Scene3d) {
        let Some(target) = &self.target else { return };
        self.queue.write_buffer(&self.pipelines.eye, 0, bytemuck::bytes_of(&eye_uniform(scene, self.content.spacing)));
        let lines = (fresh && !scene.lines.is_empty()).then(|| {
            self.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: Some("lines"),
                contents: bytemuck::cast_slice(&scene.lines),
                usage: wgpu::BufferUsages::VERTEX,
            })
        });
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("scene") });
        let end = (self.drawn + self.batch).min(self.content.uploaded);
        {
            let mut pass = target.begin(&mut encoder, fresh.then_some(scene.background));
            pass.set_bind_group(0, &self.pipelines.bindings, &[]);
            if let Some(lines) = &lines {
                pass.set_pipeline(&self.pipelines.lines);
                pass.set_vertex_buffer(0, lines.slice(..));
                pass.draw(0..scene.lines.len() as u32, 0..1);
            }
            self.drawn = self.content.draw(&mut pass, &self.pipelines, self.drawn..end);
        }
        self.queue.submit([encoder.finish()]);
    }
}

fn eye_uniform(scene: &Scene3d, spacing: f32) -> EyeUniform {
    let camera = &scene.camera;
    EyeUniform {
        clip_from_world: camera.clip_from_world().to_cols_array_2d(),
        view: [camera.width as f32, camera.height as f32, camera.focal_px, spacing * 0.75],
        disc: [scene.point_px, scene.point_px.max(24.0), 0.0, 0.0],
        place: camera.place().extend(AMBIENT).to_array(),
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::masks::Label;
    use crate::scene::{LabelledCloud, LabelledMesh};
    use crate::view::{Bounds, Orbit, RasterStyle, draw_cloud, draw_mesh};

    fn device() -> Option<(wgpu::Device, wgpu::Queue)> {
        let instance = wgpu::Instance::default();
        let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default()));
        let device =
            adapter.ok().and_then(|adapter| pollster::block_on(adapter.request_device(&Default::default())).ok());
        assert!(device.is_some() || std::env::var_os("CI").is_none(), "CI needs a (software) Vulkan adapter");
        device
    }

    fn sphere(points: usize) -> LabelledCloud {
        let mut tree = LabelTree::default();
        for id in 1..=2 {
            tree.set(Label { id: LabelId(id), name: format!("{id}"), color: [200, id as u8 * 90, 30], parent: None })
                .unwrap();
        }
        let at = |i: usize| {
            let z = 1.0 - 2.0 * (i as f32 + 0.5) / points as f32;
            let (s, c) = (i as f32 * 2.399_963).sin_cos();
            Vec3::new(c * (1.0 - z * z).sqrt(), s * (1.0 - z * z).sqrt(), z)
        };
        LabelledCloud {
            positions: (0..points).map(at).collect(),
            normals: (0..points).map(at).collect(),
            colors: vec![[90, 90, 90]; points],
            labels: (0..points).map(|i| LabelId(1 + (i * 2 / points) as u16)).collect(),
            confidence: vec![1.0; points],
            tree,
        }
    }

    fn read_back(view: &SceneView, width: u32, height: u32) -> Vec<[u8; 4]> {
        let buffer = view.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: u64::from(width * height * 4),
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let mut encoder = view.device.create_command_encoder(&Default::default());
        encoder.copy_texture_to_buffer(
            view.texture().unwrap().texture().as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &buffer,
                layout: wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(width * 4), rows_per_image: None },
            },
            wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        );
        view.queue.submit([encoder.finish()]);
        buffer.slice(..).map_async(wgpu::MapMode::Read, |result| result.unwrap());
        view.device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
        bytemuck::cast_slice(&buffer.slice(..).get_mapped_range().unwrap()).to_vec()
    }

    /// Draws until all is drawn; gives the picture, and how many calls it took.
    fn drawn(view: &mut SceneView, scene: &Scene3d) -> (Vec<[u8; 4]>, usize) {
        let calls = (1..100).find(|_| view.draw(scene)).unwrap();
        (read_back(view, scene.camera.width, scene.camera.height), calls)
    }

    fn scene(camera: ViewCamera, style: &RasterStyle) -> Scene3d {
        Scene3d {
            camera,
            coloring: style.coloring,
            hidden: style.hidden.clone(),
            tree: None,
            point_px: style.point_px,
            background: style.background,
            lines: Vec::new(),
        }
    }

    /// How many pixels of the two twins differ by no more than `most` in each channel, of a thousand.
    fn alike(gpu: &[[u8; 4]], cpu: &[[u8; 3]], most: u8) -> usize {
        let near = |(g, c): &(&[u8; 4], &[u8; 3])| g[..3].iter().zip(*c).all(|(a, b)| a.abs_diff(*b) <= most);
        gpu.iter().zip(cpu).filter(near).count() * 1000 / gpu.len()
    }

    /// A square of `side` × `side` wavy pieces, two triangles each; its right half has another label.
    fn waves(side: u32) -> LabelledMesh {
        let at = |i: u32| {
            let (x, y) = ((i % (side + 1)) as f32 / side as f32, (i / (side + 1)) as f32 / side as f32);
            Vec3::new(x, y, 0.05 * (x * 20.0).sin() * (y * 15.0).cos())
        };
        let count = (side + 1) * (side + 1);
        let mut vertices = sphere(count as usize);
        vertices.positions = (0..count).map(at).collect();
        vertices.labels = (0..count).map(|i| LabelId(1 + u16::from(i % (side + 1) > side / 2))).collect();
        let corners = (0..side * side).map(|i| i / side * (side + 1) + i % side);
        let triangles = corners.flat_map(|a| [[a, a + 1, a + side + 1], [a + 1, a + side + 2, a + side + 1]]).collect();
        let mut mesh = LabelledMesh { vertices, triangles };
        mesh.compute_normals();
        mesh
    }

    #[test]
    fn a_surface_ends_equal_to_its_cpu_twin_and_its_wires_lie_within() {
        let Some((device, queue)) = device() else {
            eprintln!("skipped: no Vulkan adapter");
            return;
        };
        let mesh = Arc::new(waves(400).split_at_labels());
        let bounds = Bounds::of(mesh.vertices.positions.iter().copied()).unwrap();
        let camera = Orbit::framing(&bounds, Vec3::new(0.3, 0.2, 1.0), Vec3::NEG_Y).camera(256, 192);
        let mut style = RasterStyle { coloring: Coloring::Label, ..Default::default() };
        let mut view = SceneView::new(&device, &queue);
        view.set_model(Model::Surface(Arc::clone(&mesh)));
        let (gpu, calls) = drawn(&mut view, &scene(camera, &style));
        assert!(calls > 1 && view.drawn() == (mesh.triangles.len(), mesh.triangles.len()));
        let cpu = draw_mesh(&mesh, &camera, &style);
        let same = alike(&gpu, &cpu.pixels, 2);
        assert!(same >= 985, "{same} of 1000 pixels agree");
        let covered = |pixels: &[[u8; 4]]| pixels.iter().filter(|pixel| pixel[..3] != style.background).count();
        let whole = covered(&gpu);
        style.hidden.insert(LabelId(2));
        let (half, _) = drawn(&mut view, &scene(camera, &style));
        assert!((35..65).contains(&(covered(&half) * 100 / whole)), "{} of {whole}", covered(&half));

        // Far apart, sides leave most of the surface open, and nothing is drawn beside it.
        let coarse = Arc::new(waves(12));
        style.hidden.clear();
        view.set_model(Model::Wireframe(Arc::clone(&coarse)));
        let (wires, _) = drawn(&mut view, &scene(camera, &style));
        view.set_model(Model::Surface(coarse));
        let (solid, _) = drawn(&mut view, &scene(camera, &style));
        assert!((15..70).contains(&(covered(&wires) * 100 / covered(&solid))), "{}", covered(&wires));
        let is_drawn = |pixel: &[u8; 4]| pixel[..3] != style.background;
        let near_solid = |at: usize| {
            let around =
                [0, 1, 255, 256, 257].into_iter().flat_map(|step| [at.checked_sub(step), at.checked_add(step)]);
            around.flatten().any(|other| solid.get(other).is_some_and(is_drawn))
        };
        let apart = (0..wires.len()).filter(|&at| is_drawn(&wires[at]) && !near_solid(at)).count();
        assert_eq!(apart, 0, "a line lies a pixel beside the surface at most");
    }

    #[test]
    fn progressive_picture_ends_equal_to_its_cpu_twin() {
        let Some((device, queue)) = device() else {
            eprintln!("skipped: no Vulkan adapter");
            return;
        };
        let cloud = Arc::new(sphere(450_000));
        let bounds = Bounds::of(cloud.positions.iter().copied()).unwrap();
        let camera = Orbit::framing(&bounds, Vec3::new(0.2, 0.3, 1.0), Vec3::NEG_Y).camera(256, 192);
        let style = RasterStyle { coloring: Coloring::Label, edl_strength: 0.0, ..Default::default() };
        let scene = scene(camera, &style);
        let mut view = SceneView::new(&device, &queue);
        view.set_model(Model::Cloud(Arc::clone(&cloud)));
        assert!(!view.draw(&scene), "one call draws a bounded batch only");
        let calls = (2..100).find(|_| view.draw(&scene)).unwrap();
        assert!(calls > 1 && view.drawn() == (450_000, 450_000));
        let gpu = read_back(&view, 256, 192);
        let cpu = draw_cloud(&cloud, &camera, &style);
        let same = alike(&gpu, &cpu.pixels, 1);
        assert!(same >= 985, "{same} of 1000 pixels agree");
        let background = cpu.pixels.iter().filter(|&&pixel| pixel == style.background).count();
        assert!(background > 2000 && background < 40_000, "the sphere fills a part of the picture: {background}");
    }
}

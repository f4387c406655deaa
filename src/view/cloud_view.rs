use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::{Duration, Instant};

use wgpu::util::DeviceExt;

use super::coloring::LabelColors;
use super::pipelines::{COLOR_FORMAT, DEPTH_FORMAT, Pipelines};
use super::points::{EyeUniform, PointInstance, SpreadOrder, pack, spacing};
use super::{Coloring, Line, ViewCamera};
use crate::masks::{LabelId, LabelTree};
use crate::scene::LabelledCloud;

/// Points per GPU buffer: 8 MB, packed in a few milliseconds.
const CHUNK: usize = 500_000;
/// What one call of [`CloudView::draw`] may cost before the batch shrinks.
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

/// Draws a cloud of any size into a texture of its own, a bounded batch of points per call: an evenly spread part of
/// the cloud at once while the camera moves, all of it within some calls when it rests.
pub struct CloudView {
    device: wgpu::Device,
    queue: wgpu::Queue,
    pipelines: Pipelines,
    cloud: Arc<LabelledCloud>,
    order: SpreadOrder,
    spacing: f32,
    chunks: Vec<wgpu::Buffer>,
    uploaded: usize,
    drawn: usize,
    batch: usize,
    scene: Option<Scene3d>,
    target: Option<Target>,
    last_draw: Option<Instant>,
}

struct Target {
    size: (u32, u32),
    color: wgpu::TextureView,
    depth: wgpu::TextureView,
}

impl CloudView {
    /// A view without points. The texture's format is `Rgba8Unorm`, holding sRGB values.
    #[must_use]
    pub fn new(device: &wgpu::Device, queue: &wgpu::Queue) -> Self {
        Self {
            device: device.clone(),
            queue: queue.clone(),
            pipelines: Pipelines::new(device),
            cloud: Arc::default(),
            order: SpreadOrder::new(0),
            spacing: 0.0,
            chunks: Vec::new(),
            uploaded: 0,
            drawn: 0,
            batch: 200_000,
            scene: None,
            target: None,
            last_draw: None,
        }
    }

    /// Shows another cloud from the next draw on; does nothing when it is the one shown.
    pub fn set_cloud(&mut self, cloud: &Arc<LabelledCloud>) {
        if !Arc::ptr_eq(&self.cloud, cloud) {
            self.cloud = Arc::clone(cloud);
            self.order = SpreadOrder::new(cloud.len());
            self.spacing = spacing(cloud);
            self.forget_points();
        }
    }

    /// Draws the next batch. Returns whether the picture is whole; call again (next frame) while it is not.
    pub fn draw(&mut self, scene: &Scene3d) -> bool {
        let fresh = self.take_over(scene);
        if !fresh && self.drawn == self.cloud.len() {
            self.last_draw = None;
            return true;
        }
        self.adapt_batch();
        self.upload_next();
        self.draw_next(fresh, scene);
        self.drawn == self.cloud.len()
    }

    /// The texture drawn into (a new one when the scene's camera has another size); `None` before the first draw.
    #[must_use]
    pub fn texture(&self) -> Option<&wgpu::TextureView> {
        self.target.as_ref().map(|target| &target.color)
    }

    /// Points drawn of the picture as it stands, and points in all.
    #[must_use]
    pub fn drawn(&self) -> (usize, usize) {
        (self.drawn, self.cloud.len())
    }

    /// Takes over what changed; returns whether the picture starts anew.
    fn take_over(&mut self, scene: &Scene3d) -> bool {
        if self.scene.as_ref() == Some(scene) {
            return self.drawn == 0 && self.uploaded == 0;
        }
        let recolored = self
            .scene
            .as_ref()
            .is_none_or(|old| old.coloring != scene.coloring || old.hidden != scene.hidden || old.tree != scene.tree);
        if recolored {
            self.forget_points();
        }
        let size = (scene.camera.width.max(1), scene.camera.height.max(1));
        if self.target.as_ref().is_none_or(|target| target.size != size) {
            self.target = Some(Target::new(&self.device, size));
        }
        self.drawn = 0;
        self.scene = Some(scene.clone());
        true
    }

    fn forget_points(&mut self) {
        self.chunks.clear();
        self.uploaded = 0;
        self.drawn = 0;
    }

    /// Fewer points per call when calls are slow, more when they are quick.
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

    fn upload_next(&mut self) {
        let Some(scene) = &self.scene else { return };
        if self.uploaded < self.cloud.len() && self.uploaded < self.drawn + self.batch {
            let end = (self.uploaded + CHUNK).min(self.cloud.len());
            let labels = LabelColors::new(scene.tree.as_ref().unwrap_or(&self.cloud.tree), &scene.hidden);
            let points = pack(&self.cloud, self.order, self.uploaded..end, scene.coloring, &labels);
            self.chunks.push(self.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: Some("points"),
                contents: bytemuck::cast_slice::<PointInstance, u8>(&points),
                usage: wgpu::BufferUsages::VERTEX,
            }));
            self.uploaded = end;
        }
    }

    fn draw_next(&mut self, fresh: bool, scene: &Scene3d) {
        let Some(target) = &self.target else { return };
        self.queue.write_buffer(&self.pipelines.eye, 0, bytemuck::bytes_of(&eye_uniform(scene, self.spacing)));
        let lines = (fresh && !scene.lines.is_empty()).then(|| {
            self.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: Some("lines"),
                contents: bytemuck::cast_slice(&scene.lines),
                usage: wgpu::BufferUsages::VERTEX,
            })
        });
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("cloud") });
        let end = (self.drawn + self.batch).min(self.uploaded);
        {
            let mut pass = target.begin(&mut encoder, fresh.then_some(scene.background));
            pass.set_bind_group(0, &self.pipelines.bindings, &[]);
            if let Some(lines) = &lines {
                pass.set_pipeline(&self.pipelines.lines);
                pass.set_vertex_buffer(0, lines.slice(..));
                pass.draw(0..scene.lines.len() as u32, 0..1);
            }
            pass.set_pipeline(&self.pipelines.points);
            for (index, chunk) in self.chunks.iter().enumerate() {
                let first = index * CHUNK;
                let (from, to) = (self.drawn.max(first), end.min(first + CHUNK));
                if from < to {
                    pass.set_vertex_buffer(0, chunk.slice(..));
                    pass.draw(0..4, (from - first) as u32..(to - first) as u32);
                }
            }
        }
        self.queue.submit([encoder.finish()]);
        self.drawn = end;
    }
}

fn eye_uniform(scene: &Scene3d, spacing: f32) -> EyeUniform {
    let camera = &scene.camera;
    EyeUniform {
        clip_from_world: camera.clip_from_world().to_cols_array_2d(),
        view: [camera.width as f32, camera.height as f32, camera.focal_px, spacing * 0.75],
        disc: [scene.point_px, scene.point_px.max(24.0), 0.0, 0.0],
    }
}

impl Target {
    fn new(device: &wgpu::Device, size: (u32, u32)) -> Self {
        let texture = |format, usage| {
            let texture = device.create_texture(&wgpu::TextureDescriptor {
                label: Some("cloud"),
                size: wgpu::Extent3d { width: size.0, height: size.1, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT | usage,
                view_formats: &[],
            });
            texture.create_view(&wgpu::TextureViewDescriptor::default())
        };
        let color = texture(COLOR_FORMAT, wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_SRC);
        Self { size, color, depth: texture(DEPTH_FORMAT, wgpu::TextureUsages::empty()) }
    }

    /// Begins a pass over what was drawn before, or over `background` where one is given.
    fn begin<'e>(&self, encoder: &'e mut wgpu::CommandEncoder, background: Option<[u8; 3]>) -> wgpu::RenderPass<'e> {
        let load = background.map_or(wgpu::LoadOp::Load, |rgb| {
            let [r, g, b] = rgb.map(|channel| f64::from(channel) / 255.0);
            wgpu::LoadOp::Clear(wgpu::Color { r, g, b, a: 1.0 })
        });
        let depth_load = if background.is_some() { wgpu::LoadOp::Clear(0.0) } else { wgpu::LoadOp::Load };
        encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("cloud"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &self.color,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load, store: wgpu::StoreOp::Store },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &self.depth,
                depth_ops: Some(wgpu::Operations { load: depth_load, store: wgpu::StoreOp::Store }),
                stencil_ops: None,
            }),
            ..Default::default()
        })
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::masks::Label;
    use crate::view::{Bounds, Orbit, RasterStyle, draw_cloud};

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

    fn read_back(view: &CloudView, width: u32, height: u32) -> Vec<[u8; 4]> {
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
        let scene = Scene3d {
            camera,
            coloring: style.coloring,
            hidden: style.hidden.clone(),
            tree: None,
            point_px: style.point_px,
            background: style.background,
            lines: Vec::new(),
        };
        let mut view = CloudView::new(&device, &queue);
        view.set_cloud(&cloud);
        assert!(!view.draw(&scene), "one call draws a bounded batch only");
        let calls = (2..100).find(|_| view.draw(&scene)).unwrap();
        assert!(calls > 1 && view.drawn() == (450_000, 450_000));
        let gpu = read_back(&view, 256, 192);
        let cpu = draw_cloud(&cloud, &camera, &style);
        let equal = gpu
            .iter()
            .zip(&cpu.pixels)
            .filter(|(g, c)| g[..3].iter().zip(*c).all(|(a, b)| a.abs_diff(*b) <= 1))
            .count();
        assert!(equal * 1000 >= gpu.len() * 985, "{equal} of {} pixels agree", gpu.len());
        let background = cpu.pixels.iter().filter(|&&pixel| pixel == style.background).count();
        assert!(background > 2000 && background < 40_000, "the sphere fills a part of the picture: {background}");
    }
}

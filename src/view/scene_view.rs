use std::sync::Arc;
use std::time::{Duration, Instant};

use wgpu::util::DeviceExt;

use super::content::{Content, Model};
use super::eye_dome::EyeDome;
use super::mesh_raster::AMBIENT;
use super::pipelines::Pipelines;
use super::points::EyeUniform;
use super::target::Target;
use super::{Line, PicturePlane, SceneStyle, ViewCamera};

/// What one call of [`SceneView::draw`] may cost before the batch shrinks.
const FRAME_BUDGET: Duration = Duration::from_millis(40);

/// All that decides what the 3-D view shows; a change of anything starts the picture anew.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene3d {
    /// Where it is seen from; its size is the texture's size.
    pub camera: ViewCamera,
    /// How it is drawn.
    pub style: SceneStyle,
    /// Line segments, e.g. [`super::frustum_lines`]; never clipped.
    pub lines: Vec<Line>,
    /// Pictures that stand in it; never clipped.
    pub planes: Vec<PicturePlane>,
}

/// Draws a cloud or a surface of any size into a texture of its own, a bounded batch of points or triangles per call: a
/// part that is spread over the whole at once while the camera moves, all of it within some calls when it rests.
pub struct SceneView {
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    pipelines: Pipelines,
    dome: EyeDome,
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
            dome: EyeDome::new(device),
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
            self.content.upload_next(&self.device, &scene.style.appearance);
        }
        self.draw_next(fresh, scene);
        self.drawn == self.content.len
    }

    /// The texture drawn into (a new one when the scene's camera has another size); `None` before the first draw.
    #[must_use]
    pub fn texture(&self) -> Option<&wgpu::TextureView> {
        self.target.as_ref().map(|target| &target.lit)
    }

    /// Points or triangles drawn of the picture as it stands, and all that there are.
    #[must_use]
    pub fn drawn(&self) -> (usize, usize) {
        (self.drawn, self.content.len)
    }

    /// What the ends of the ramp stand for that colours come from; `None` where they come from none.
    #[must_use]
    pub fn range(&self) -> Option<[f32; 2]> {
        self.content.range()
    }

    /// Takes over what changed; returns whether the picture starts anew.
    fn take_over(&mut self, scene: &Scene3d) -> bool {
        if self.scene.as_ref() == Some(scene) {
            return self.drawn == 0 && self.content.uploaded == 0;
        }
        let recolored = self.scene.as_ref().is_none_or(|old| old.style.appearance != scene.style.appearance);
        if recolored {
            self.content.forget();
        }
        let size = (scene.camera.width.max(1), scene.camera.height.max(1));
        if self.target.as_ref().is_none_or(|target| target.size != size) {
            self.target = Some(Target::new(&self.device, &self.dome, size));
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
        self.dome.set(&self.queue, self.content.edl_strength(scene.style.edl_strength), &scene.camera);
        let lines = (fresh && !scene.lines.is_empty()).then(|| {
            self.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: Some("lines"),
                contents: bytemuck::cast_slice(&scene.lines),
                usage: wgpu::BufferUsages::VERTEX,
            })
        });
        let planes = (fresh && !scene.planes.is_empty())
            .then(|| self.pipelines.planes.place(&self.device, &self.queue, &scene.planes));
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("scene") });
        let end = (self.drawn + self.batch).min(self.content.uploaded);
        {
            let mut pass = target.begin(&mut encoder, fresh.then_some(scene.style.background));
            pass.set_bind_group(0, &self.pipelines.bindings, &[]);
            if let Some(lines) = &lines {
                pass.set_pipeline(&self.pipelines.lines);
                pass.set_vertex_buffer(0, lines.slice(..));
                pass.draw(0..scene.lines.len() as u32, 0..1);
            }
            if let Some(planes) = &planes {
                self.pipelines.planes.draw(&mut pass, planes);
            }
            self.drawn = self.content.draw(&mut pass, &self.pipelines, self.drawn..end);
        }
        target.light(&mut encoder, &self.dome);
        self.queue.submit([encoder.finish()]);
    }
}

fn eye_uniform(scene: &Scene3d, spacing: f32) -> EyeUniform {
    let camera = &scene.camera;
    EyeUniform {
        clip_from_world: camera.clip_from_world().to_cols_array_2d(),
        cube_from_world: scene.style.clip.cube_from_world.to_cols_array_2d(),
        view: [camera.width as f32, camera.height as f32, camera.px_per_unit(1.0), spacing * 0.75],
        disc: [scene.style.point_px, scene.style.point_px.max(24.0), 0.0, 0.0],
        place: camera.place().extend(AMBIENT).to_array(),
    }
}

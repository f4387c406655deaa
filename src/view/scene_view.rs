use std::time::{Duration, Instant};

use wgpu::util::DeviceExt;

use super::ViewCamera;
use super::content::{Content, PointsOver, Scene3d, SceneModel};
use super::mesh_raster::AMBIENT;
use super::paint::Paint;
use super::pipelines::{EyeUniform, Pipelines, PointInstance};
use super::target::{EyeDome, Gpu, Target};

/// Maximum duration of one call of [`SceneView::draw`] before the batch shrinks.
const FRAME_BUDGET: Duration = Duration::from_millis(40);

/// Draws a cloud or a surface of any size into its own texture, one bounded batch per call.
///
/// While the camera moves, the first call shows a part of the points or triangles that is spread
/// over all in view. When the camera rests, further calls complete the image. Triangles fill up the
/// visible image. Points are drawn as finer images off screen, each shown when it is complete,
/// until all points are drawn.
pub struct SceneView {
    gpu: Gpu,
    pipelines: Pipelines,
    dome: EyeDome,
    content: Content,
    /// Points over the model that are on the GPU.
    over: Option<(PointsOver, wgpu::Buffer)>,
    /// Whether the image must restart for the same scene.
    is_stale: bool,
    batch: usize,
    scene: Option<Scene3d>,
    target: Option<Target>,
    /// Start of the last batch; `None` if the previous call drew nothing.
    last_draw: Option<Instant>,
    /// Number of points or triangles in the last batch.
    last_count: usize,
}

impl SceneView {
    /// Creates a view without points; the texture has format `Rgba8Unorm` and holds sRGB values.
    #[must_use]
    pub fn new(device: &wgpu::Device, queue: &wgpu::Queue) -> Self {
        Self {
            gpu: Gpu {
                device: device.clone(),
                queue: queue.clone(),
            },
            pipelines: Pipelines::new(device),
            dome: EyeDome::new(device),
            content: Content::empty(),
            over: None,
            is_stale: true,
            batch: 200_000,
            scene: None,
            target: None,
            last_draw: None,
            last_count: 0,
        }
    }

    /// Sets the model; does nothing if it is already shown.
    ///
    /// A cloud is arranged in the background first; until then the old image stays.
    pub fn set_model(&mut self, model: SceneModel) {
        if !self.content.shows(&model) {
            self.content = Content::new(model, &self.content);
            self.is_stale = true;
        }
    }

    /// Forgets the model and its image.
    ///
    /// Until the next model is drawn, the view is empty instead of showing the old image.
    pub fn clear(&mut self) {
        self.content = Content::empty();
        self.over = None;
        self.scene = None;
        self.target = None;
        self.last_draw = None;
        self.is_stale = true;
    }

    /// Uploads the points over the model if they have changed.
    fn upload_over(&mut self, scene: &Scene3d) {
        let known = self.over.as_ref().map(|(over, _)| over);
        if known == scene.over.as_ref() {
            return;
        }
        let over = scene.over.as_ref().filter(|over| !over.0.is_empty());
        self.over = over.map(|over| {
            let PointsOver(cloud) = over;
            let paint = Paint::new(cloud, &scene.style.appearance);
            let pack = |index: usize| PointInstance {
                position: cloud.positions[index].to_array(),
                color: paint.color(cloud, index).unwrap_or_default(),
                radius: 0.0,
            };
            let packed: Vec<PointInstance> = (0..cloud.len()).map(pack).collect();
            let init = wgpu::util::BufferInitDescriptor {
                label: Some("points over the model"),
                contents: bytemuck::cast_slice(&packed),
                usage: wgpu::BufferUsages::VERTEX,
            };
            (over.clone(), self.gpu.device.create_buffer_init(&init))
        });
    }

    /// Draws the next batch and returns whether the image is complete.
    ///
    /// Call it again in the next frame while it returns false.
    pub fn draw(&mut self, scene: &Scene3d) -> bool {
        self.is_stale |= self.content.receive();
        self.fit_target(&scene.camera);
        if !self.content.is_ready() {
            self.last_draw = None;
            return false;
        }
        let fresh = self.take_over(scene);
        if !fresh && self.content.is_whole() {
            self.last_draw = None;
            return self.content.is_final();
        }
        self.adapt_batch();
        let begins = fresh || self.content.is_drawn();
        if fresh {
            self.content.begin(&self.gpu, scene, self.batch);
        } else {
            if begins {
                self.content.refine();
            }
            self.content
                .upload_next(&self.gpu, &scene.style.appearance, self.batch);
        }
        self.draw_next(begins, scene);
        self.content.is_whole() && self.content.is_final()
    }

    /// Returns the texture that is drawn into; `None` before the first draw.
    ///
    /// The texture is replaced when the size of the scene's camera changes.
    #[must_use]
    pub fn texture(&self) -> Option<&wgpu::TextureView> {
        self.target.as_ref().map(|target| &target.lit)
    }

    /// Returns how many points or triangles of the current image are drawn, and how many exist.
    #[must_use]
    pub fn drawn(&self) -> (usize, usize) {
        (self.content.drawn(), self.content.len())
    }

    /// Returns the values at the ends of the colour ramp; `None` if the colours use no ramp.
    #[must_use]
    pub fn range(&self) -> Option<[f32; 2]> {
        self.content.range()
    }

    fn fit_target(&mut self, camera: &ViewCamera) {
        if !self
            .target
            .as_ref()
            .is_some_and(|target| target.fits(camera))
        {
            self.target = Some(Target::new(&self.gpu.device, &self.dome, camera));
        }
    }

    /// Applies changes of the scene; returns whether the image restarts.
    fn take_over(&mut self, scene: &Scene3d) -> bool {
        if self.scene.as_ref() != Some(scene) {
            let recolored = self
                .scene
                .as_ref()
                .is_none_or(|old| old.style.appearance != scene.style.appearance);
            if recolored {
                self.content.forget();
                self.over = None;
            }
            self.scene = Some(scene.clone());
            self.is_stale = true;
        }
        std::mem::take(&mut self.is_stale)
    }

    /// Shrinks the batch if calls are slow; grows it if full batches are fast.
    fn adapt_batch(&mut self) {
        if let Some(last) = self.last_draw.replace(Instant::now()) {
            let took = last.elapsed();
            if took > FRAME_BUDGET * 3 / 2 {
                self.batch = (self.batch / 2).max(50_000);
            } else if took < FRAME_BUDGET / 2 && self.last_count * 2 > self.batch {
                self.batch = (self.batch * 3 / 2).min(4_000_000);
            }
        }
    }

    /// Draws a batch over the background if an image `begins`, otherwise over the earlier batches.
    fn draw_next(&mut self, begins: bool, scene: &Scene3d) {
        if begins {
            self.upload_over(scene);
        }
        let Some(target) = &self.target else { return };
        let Gpu { device, queue } = &self.gpu;
        queue.write_buffer(
            &self.pipelines.eye,
            0,
            bytemuck::bytes_of(&eye_uniform(scene)),
        );
        self.dome.set(
            queue,
            self.content.edl_strength(scene.style.edl_strength),
            &scene.camera,
        );
        let lines = (begins && !scene.lines.is_empty()).then(|| {
            device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: Some("lines"),
                contents: bytemuck::cast_slice(&scene.lines),
                usage: wgpu::BufferUsages::VERTEX,
            })
        });
        let planes = (begins && !scene.planes.is_empty())
            .then(|| self.pipelines.planes.place(device, queue, &scene.planes));
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor {
            label: Some("scene"),
        });
        let before = if begins { 0 } else { self.content.drawn() };
        {
            let mut pass = target.begin(&mut encoder, begins.then_some(scene.style.background));
            pass.set_bind_group(0, &self.pipelines.bindings, &[]);
            if let Some(lines) = &lines {
                pass.set_pipeline(&self.pipelines.lines);
                pass.set_vertex_buffer(0, lines.slice(..));
                pass.draw(0..scene.lines.len() as u32, 0..1);
            }
            if let Some((PointsOver(cloud), points)) = self.over.as_ref().filter(|_| begins) {
                pass.set_pipeline(&self.pipelines.points);
                self.pipelines.splat_scales.bind(&mut pass, 1, 1);
                pass.set_vertex_buffer(0, points.slice(..));
                pass.draw(0..4, 0..cloud.len() as u32);
            }
            if let Some(planes) = &planes {
                self.pipelines.planes.draw(&mut pass, planes);
            }
            self.content.draw(&mut pass, &self.pipelines, self.batch);
        }
        self.last_count = self.content.drawn() - before;
        if self.content.is_presentable() {
            target.light(&mut encoder, &self.dome);
        }
        queue.submit([encoder.finish()]);
    }
}

fn eye_uniform(scene: &Scene3d) -> EyeUniform {
    let camera = &scene.camera;
    EyeUniform {
        clip_from_world: camera.clip_from_world().to_cols_array_2d(),
        cube_from_world: scene.style.clip.cube_from_world.to_cols_array_2d(),
        view: [
            camera.width as f32,
            camera.height as f32,
            camera.px_per_unit(1.0),
            0.0,
        ],
        disc: [scene.style.point_px, scene.style.most_px(), 0.0, 0.0],
        place: camera.place().extend(AMBIENT).to_array(),
    }
}

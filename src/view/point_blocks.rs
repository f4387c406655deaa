use std::sync::Arc;

use super::arrangement::Arrangement;
use super::frustum::Frustum;
use super::paint::Paint;
use super::pipelines::Pipelines;
use super::points::PointInstance;
use super::shares::shares;
use super::{SceneStyle, ViewCamera};
use ostra_cloud::LabelledCloud;

/// Points handed to the GPU in one call, packed in about 10 ms. One thread packs: the pool of the program's jobs may be
/// busy for seconds.
const UPLOAD: usize = 250_000;
/// How many times the points of the picture before a refined picture has.
const FINER: usize = 6;

/// An arrangement of points on the GPU and the picture that is being drawn of it: of each block that is seen a share of its
/// points, which begins with the first of the block's order.
pub(super) struct PointBlocks {
    arrangement: Arc<Arrangement>,
    on_gpu: Vec<OnGpu>,
    parts: Vec<Part>,
}

/// The first points of a block.
#[derive(Default)]
struct OnGpu {
    points: Option<wgpu::Buffer>,
    count: usize,
}

/// What a picture shows of one block.
struct Part {
    block: usize,
    all: usize,
    /// The area it takes on the screen, in pixels, roughly.
    area_px: f32,
    share: usize,
    drawn: usize,
}

impl PointBlocks {
    pub fn new(arrangement: Arc<Arrangement>) -> Self {
        let on_gpu = arrangement
            .blocks
            .iter()
            .map(|_| OnGpu::default())
            .collect();
        Self {
            arrangement,
            on_gpu,
            parts: Vec::new(),
        }
    }

    pub fn arrangement(&self) -> &Arc<Arrangement> {
        &self.arrangement
    }

    /// Colours are others now: all is to be uploaded anew.
    pub fn forget(&mut self) {
        self.on_gpu.iter_mut().for_each(|block| block.count = 0);
    }

    /// Begins a picture of about `budget` points, divided among the blocks that are seen by their size on the screen.
    pub fn begin(&mut self, camera: &ViewCamera, style: &SceneStyle, budget: usize) {
        let frustum = Frustum::new(camera, style);
        let blocks = self.arrangement.blocks.iter().enumerate();
        let mut seen: Vec<(f32, Part)> = blocks
            .filter(|(_, block)| frustum.reaches(&block.bounds))
            .map(|(number, block)| {
                let radius = block.bounds.radius();
                let depth = camera
                    .camera_from_world
                    .transform_point3(block.bounds.centre())
                    .z;
                let area_px = (radius * camera.px_per_unit(depth.max(radius)))
                    .powi(2)
                    .max(f32::MIN_POSITIVE);
                (
                    depth,
                    Part {
                        block: number,
                        all: block.len(),
                        area_px,
                        share: 0,
                        drawn: 0,
                    },
                )
            })
            .collect();
        // What is near hides what is far: pixels are then shaded once.
        seen.sort_by(|a, b| a.0.total_cmp(&b.0));
        self.parts = seen.into_iter().map(|(_, part)| part).collect();
        self.divide(budget);
    }

    /// Begins a picture of the same blocks with several times the points, or all of them.
    pub fn refine(&mut self) {
        let (drawn, all) = self.parts.iter().fold((0, 0), |(drawn, all), part| {
            (drawn + part.share, all + part.all)
        });
        let budget = drawn * FINER;
        // A picture of most points would take as long as that of all.
        self.divide(if budget * 2 < all { budget } else { all });
    }

    fn divide(&mut self, budget: usize) {
        let takers: Vec<(usize, f32)> = self
            .parts
            .iter()
            .map(|part| (part.all, part.area_px))
            .collect();
        for (part, share) in self.parts.iter_mut().zip(shares(&takers, budget)) {
            (part.share, part.drawn) = (share, 0);
        }
    }

    /// Makes do with what the GPU has, so that the picture can be drawn at once.
    pub fn settle(&mut self) {
        self.parts
            .iter_mut()
            .for_each(|part| part.share = part.share.min(self.on_gpu[part.block].count));
    }

    /// Hands the GPU a bounded part more: first some of all blocks, so that whatever comes into view is there, then what
    /// the picture needs.
    pub fn upload_next(
        &mut self,
        gpu: (&wgpu::Device, &wgpu::Queue),
        cloud: &LabelledCloud,
        paint: &Paint,
    ) {
        if self.on_gpu.iter().any(|block| block.count == 0) {
            let total = self.arrangement.len().max(UPLOAD);
            for block in 0..self.on_gpu.len() {
                let first = (self.arrangement.blocks[block].len() * UPLOAD).div_ceil(total);
                self.upload(gpu, cloud, paint, (block, first));
            }
            return;
        }
        let mut room = UPLOAD;
        for part in 0..self.parts.len() {
            let Part {
                block, all, share, ..
            } = self.parts[part];
            let has = self.on_gpu[block].count;
            if share > has && room > 0 {
                // Twice as many at least: uploads are few.
                let end = share.max(has * 2).min(all).min(has + room);
                self.upload(gpu, cloud, paint, (block, end));
                room -= end - has;
            }
        }
    }

    /// Makes the first `end` points of a block be on the GPU.
    fn upload(
        &mut self,
        (device, queue): (&wgpu::Device, &wgpu::Queue),
        cloud: &LabelledCloud,
        paint: &Paint,
        (block, end): (usize, usize),
    ) {
        let OnGpu { points, count } = &mut self.on_gpu[block];
        let pack = |(index, radius): (usize, f32)| PointInstance {
            position: cloud.positions[index].to_array(),
            color: paint.color(cloud, index).unwrap_or_default(),
            radius,
        };
        let packed: Vec<PointInstance> = self
            .arrangement
            .part_of(block, *count..end)
            .map(pack)
            .collect();
        let size = size_of::<PointInstance>() as u64;
        let buffer = points.get_or_insert_with(|| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("points"),
                size: self.arrangement.blocks[block].len() as u64 * size,
                usage: wgpu::BufferUsages::VERTEX | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        });
        queue.write_buffer(buffer, *count as u64 * size, bytemuck::cast_slice(&packed));
        *count = end;
    }

    /// Draws at most `most` points more of the picture.
    pub fn draw(&mut self, pass: &mut wgpu::RenderPass<'_>, pipelines: &Pipelines, most: usize) {
        pass.set_pipeline(&pipelines.points);
        // Shares of 1 at least may add up to more than the budget by this.
        let mut room = most + self.parts.len();
        for part in &mut self.parts {
            let OnGpu { points, count } = &self.on_gpu[part.block];
            let end = part.share.min(*count).min(part.drawn + room);
            if let (Some(points), true) = (points, part.drawn < end) {
                pipelines.growths.bind(pass, part.share, part.all);
                let size = size_of::<PointInstance>() as u64;
                pass.set_vertex_buffer(0, points.slice(..*count as u64 * size));
                pass.draw(0..4, part.drawn as u32..end as u32);
                room -= end - part.drawn;
                part.drawn = end;
            }
        }
    }

    /// How many points of the picture are drawn.
    pub fn drawn(&self) -> usize {
        self.parts.iter().map(|part| part.drawn).sum()
    }

    /// Whether the picture is drawn.
    pub fn is_drawn(&self) -> bool {
        self.parts.iter().all(|part| part.drawn == part.share)
    }

    /// Whether the picture is drawn and shows every point of the blocks that are seen.
    pub fn is_whole(&self) -> bool {
        self.parts.iter().all(|part| part.drawn == part.all)
    }
}

//! Points on the GPU in blocks: visibility, number of points shown per block, and upload.

use std::sync::Arc;

use glam::Vec4;

use super::paint::Paint;
use super::pipelines::{Pipelines, PointInstance};
use super::point_lod::{Disc, PointLod};
use super::target::Gpu;
use super::{Bounds, SceneStyle, ViewCamera};
use ostra_cloud::LabelledCloud;

/// Maximum number of points uploaded per call; packing them takes about 10 ms.
///
/// One thread packs, because the pool of the program's jobs may be busy for seconds.
const UPLOAD: usize = 250_000;
/// Factor by which a refined image has more points than the one before.
const FINER: usize = 6;

/// An arrangement on the GPU and the image that is being drawn of it.
///
/// The image shows a share of the points of each visible block: the first ones in the block's
/// order.
pub(super) struct PointBlocks {
    point_lod: Arc<PointLod>,
    on_gpu: Vec<OnGpu>,
    parts: Vec<VisibleBlock>,
}

/// The first points of a block.
#[derive(Default)]
struct OnGpu {
    points: Option<wgpu::Buffer>,
    count: usize,
}

/// The part of one block that an image shows.
struct VisibleBlock {
    block: usize,
    all: usize,
    /// Approximate area on the screen in square pixels.
    area_px: f32,
    share: usize,
    drawn: usize,
}

impl PointBlocks {
    pub fn new(point_lod: Arc<PointLod>) -> Self {
        let on_gpu = point_lod.blocks.iter().map(|_| OnGpu::default()).collect();
        Self {
            point_lod,
            on_gpu,
            parts: Vec::new(),
        }
    }

    pub fn point_lod(&self) -> &Arc<PointLod> {
        &self.point_lod
    }

    /// Discards the uploaded points after a change of colours.
    pub fn forget(&mut self) {
        self.on_gpu.iter_mut().for_each(|block| block.count = 0);
    }

    /// Starts an image of about `budget` points.
    ///
    /// The budget is divided among the visible blocks by their size on the screen.
    pub fn begin(&mut self, camera: &ViewCamera, style: &SceneStyle, budget: usize) {
        let frustum = Frustum::new(camera, style);
        let blocks = self.point_lod.blocks.iter().enumerate();
        let mut seen: Vec<(f32, VisibleBlock)> = blocks
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
                    VisibleBlock {
                        block: number,
                        all: block.len(),
                        area_px,
                        share: 0,
                        drawn: 0,
                    },
                )
            })
            .collect();
        // Near blocks come first: they occlude far ones, so that pixels are shaded once.
        seen.sort_by(|a, b| a.0.total_cmp(&b.0));
        self.parts = seen.into_iter().map(|(_, part)| part).collect();
        self.divide(budget);
    }

    /// Starts an image of the same blocks with several times the points, or all of them.
    pub fn refine(&mut self) {
        let (drawn, all) = self.parts.iter().fold((0, 0), |(drawn, all), part| {
            (drawn + part.share, all + part.all)
        });
        let budget = drawn * FINER;
        // Drawing most points would take as long as drawing all of them.
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

    /// Limits the image to the points on the GPU, so that it can be drawn at once.
    pub fn settle(&mut self) {
        self.parts
            .iter_mut()
            .for_each(|part| part.share = part.share.min(self.on_gpu[part.block].count));
    }

    /// Uploads a bounded part of the points.
    ///
    /// First come some points of all blocks, so that anything that comes into view can be drawn.
    /// Then come the points that the image needs.
    pub fn upload_next(&mut self, gpu: &Gpu, cloud: &LabelledCloud, paint: &Paint) {
        if self.on_gpu.iter().any(|block| block.count == 0) {
            let total = self.point_lod.len().max(UPLOAD);
            for block in 0..self.on_gpu.len() {
                let first = (self.point_lod.blocks[block].len() * UPLOAD).div_ceil(total);
                self.upload(gpu, cloud, paint, block, first);
            }
            return;
        }
        let mut room = UPLOAD;
        for part in 0..self.parts.len() {
            let VisibleBlock {
                block, all, share, ..
            } = self.parts[part];
            let has = self.on_gpu[block].count;
            if share > has && room > 0 {
                // At least doubling the points keeps the number of uploads small.
                let end = share.max(has * 2).min(all).min(has + room);
                self.upload(gpu, cloud, paint, block, end);
                room -= end - has;
            }
        }
    }

    /// Uploads points until the first `end` points of a block are on the GPU.
    fn upload(
        &mut self,
        gpu: &Gpu,
        cloud: &LabelledCloud,
        paint: &Paint,
        block: usize,
        end: usize,
    ) {
        let OnGpu { points, count } = &mut self.on_gpu[block];
        let pack = |disc: Disc| PointInstance {
            position: cloud.positions[disc.index].to_array(),
            color: disc.shade(paint.color(cloud, disc.index).unwrap_or_default()),
            radius: disc.radius,
        };
        let packed: Vec<PointInstance> = self
            .point_lod
            .part_of(block, *count..end)
            .map(pack)
            .collect();
        let size = size_of::<PointInstance>() as u64;
        let buffer = points.get_or_insert_with(|| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("points"),
                size: self.point_lod.blocks[block].len() as u64 * size,
                usage: wgpu::BufferUsages::VERTEX | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        });
        gpu.queue
            .write_buffer(buffer, *count as u64 * size, bytemuck::cast_slice(&packed));
        *count = end;
    }

    /// Draws at most `most` more points of the image.
    pub fn draw(&mut self, pass: &mut wgpu::RenderPass<'_>, pipelines: &Pipelines, most: usize) {
        pass.set_pipeline(&pipelines.points);
        // Every share is at least 1, so the shares may exceed the budget by the number of parts.
        let mut room = most + self.parts.len();
        for part in &mut self.parts {
            let OnGpu { points, count } = &self.on_gpu[part.block];
            let end = part.share.min(*count).min(part.drawn + room);
            if let (Some(points), true) = (points, part.drawn < end) {
                pipelines.splat_scales.bind(pass, part.share, part.all);
                let size = size_of::<PointInstance>() as u64;
                pass.set_vertex_buffer(0, points.slice(..*count as u64 * size));
                pass.draw(0..4, part.drawn as u32..end as u32);
                room -= end - part.drawn;
                part.drawn = end;
            }
        }
    }

    /// Returns how many points of the image are drawn.
    pub fn drawn(&self) -> usize {
        self.parts.iter().map(|part| part.drawn).sum()
    }

    /// Returns whether the image is drawn completely.
    pub fn is_drawn(&self) -> bool {
        self.parts.iter().all(|part| part.drawn == part.share)
    }

    /// Returns whether the image is drawn and shows every point of the visible blocks.
    pub fn is_whole(&self) -> bool {
        self.parts.iter().all(|part| part.drawn == part.all)
    }
}

/// The visible part of space: the intersection of the camera frustum and the clip box.
pub(super) struct Frustum {
    /// Planes; a point is inside where all `normal · x + offset` are at least 0.
    planes: [Vec4; 12],
}

impl Frustum {
    /// Creates a frustum wider than the image by the largest disc.
    ///
    /// Discs centred just outside the image reach into it.
    pub fn new(camera: &ViewCamera, style: &SceneStyle) -> Self {
        let clip = camera.clip_from_world();
        let [x, y, z, w] = [0, 1, 2, 3].map(|row| clip.row(row));
        let beyond = |size: u32| 1.0 + 2.0 * (style.most_px() + 1.0) / size.max(1) as f32;
        let (wide, high) = (w * beyond(camera.width), w * beyond(camera.height));
        let cube = style.clip.cube_from_world;
        let [u, v, t, one] = [0, 1, 2, 3].map(|row| cube.row(row));
        let sides = [wide + x, wide - x, high + y, high - y, w - z, z];
        let walls = [one + u, one - u, one + v, one - v, one + t, one - t];
        Self {
            planes: std::array::from_fn(|at| if at < 6 { sides[at] } else { walls[at - 6] }),
        }
    }

    /// Returns whether anything in a box may be visible; `false` is always correct.
    pub fn reaches(&self, bounds: &Bounds) -> bool {
        let (centre, half) = (bounds.centre(), (bounds.max - bounds.min) / 2.0);
        self.planes.iter().all(|plane| {
            let normal = plane.truncate();
            let reach = normal.abs().dot(half);
            let rounding = 1e-5 * (normal.abs().dot(centre.abs()) + reach + plane.w.abs());
            normal.dot(centre) + plane.w + reach >= -rounding
        })
    }
}

/// Divides `budget` among takers in proportion to their weights (above 0).
///
/// A taker is a maximum and a weight. No taker gets more than its maximum; the remainder goes to
/// the others. Each taker gets at least 1.
pub(super) fn shares(takers: &[(usize, f32)], budget: usize) -> Vec<usize> {
    let mut by_need: Vec<usize> = (0..takers.len()).collect();
    let need = |&taker: &usize| takers[taker].0 as f32 / takers[taker].1;
    by_need.sort_by(|a, b| need(a).total_cmp(&need(b)));
    let mut shares = vec![0; takers.len()];
    let (mut left, mut weights) = (
        budget as f64,
        takers.iter().map(|taker| f64::from(taker.1)).sum::<f64>(),
    );
    for taker in by_need {
        let (most, weight) = (takers[taker].0, f64::from(takers[taker].1));
        let fair = left * weight / weights.max(weight);
        shares[taker] = most.min((fair as usize).max(1));
        left = (left - shares[taker] as f64).max(0.0);
        weights -= weight;
    }
    shares
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use proptest::prelude::*;

    use super::*;
    use crate::{Axes, Clip, Orbit};

    fn orbit() -> Orbit {
        Orbit::framing(
            &Bounds {
                min: Vec3::NEG_ONE,
                max: Vec3::ONE,
            },
            Vec3::new(0.3, 0.2, 1.0),
            Vec3::NEG_Y,
        )
    }

    fn around(x: Vec3, half: f32) -> Bounds {
        Bounds {
            min: x - half,
            max: x + half,
        }
    }

    proptest! {
        #[test]
        fn box_with_a_visible_point_is_in_the_frustum(
            at in prop::array::uniform3(-4.0_f32..4.0),
            off in prop::array::uniform3(-1.0_f32..1.0),
            (half, closer, orthographic, clipped) in (0.0_f32..2.0, 0.02_f32..2.0, any::<bool>(), any::<bool>()),
        ) {
            let mut orbit = Orbit { orthographic, ..orbit() };
            orbit.distance *= closer;
            let camera = orbit.camera(320, 200);
            let sides = around(Vec3::new(0.2, -0.1, 0.3), 0.8);
            let axes = Axes::new(Vec3::new(0.2, -1.0, 0.1), Vec3::Z);
            let clip = if clipped { Clip::inside(&axes, &sides) } else { Clip::default() };
            let style = SceneStyle { clip, ..SceneStyle::default() };
            let x = Vec3::from_array(at);
            let is_drawn = clip.contains(x) && camera.project(x).is_some_and(|(px, _)| {
                let most = style.most_px();
                px.x > -most && px.y > -most && px.x < 320.0 + most && px.y < 200.0 + most
            });
            let bounds = around(x + Vec3::from_array(off) * half, half);
            prop_assert!(!is_drawn || Frustum::new(&camera, &style).reaches(&bounds));
        }
    }

    #[test]
    fn boxes_outside_the_frustum_or_the_clip_box_are_rejected() {
        let camera = orbit().camera(320, 200);
        let style = SceneStyle::default();
        let (inside, behind) = (
            around(Vec3::ZERO, 0.1),
            camera.unproject(glam::Vec2::new(160.0, 100.0), -2.0),
        );
        let adjacent = camera.unproject(glam::Vec2::new(-200.0, 100.0), 3.0);
        let frustum = Frustum::new(&camera, &style);
        assert!(frustum.reaches(&inside) && frustum.reaches(&around(adjacent, 50.0)));
        assert!(!frustum.reaches(&around(behind, 0.1)) && !frustum.reaches(&around(adjacent, 0.1)));
        let axes = Axes::new(Vec3::NEG_Y, Vec3::Z);
        let clip = Clip::inside(
            &axes,
            &axes
                .bounds([Vec3::splat(0.5), Vec3::ONE].into_iter())
                .unwrap(),
        );
        let clipped = Frustum::new(&camera, &SceneStyle { clip, ..style });
        assert!(!clipped.reaches(&inside) && clipped.reaches(&around(Vec3::splat(0.7), 0.1)));
    }

    #[test]
    fn excess_share_is_distributed_to_the_others_by_weight() {
        assert_eq!(
            shares(&[(100, 1.0), (10, 5.0), (100, 2.0)], 100),
            [30, 10, 60]
        );
        assert_eq!(
            shares(&[(100, 1.0), (10, 5.0)], 1000),
            [100, 10],
            "no more than there is"
        );
        assert_eq!(
            shares(&[(100, 1e-9), (100, 1.0)], 50),
            [1, 49],
            "no one is left out"
        );
        assert!(shares(&[], 50).is_empty());
    }
}

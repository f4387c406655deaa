use glam::{DVec3, IVec3, Vec2, Vec3};
use rayon::prelude::*;
use wide::f32x8;

use super::block::{Block, EDGE, voxel_at};
use super::blocks::Volume;
use super::measured::{Measured, Pixel};
use crate::engine::job::{Progress, Stopped};

/// Rows of pixels that one task looks at for blocks near what they see.
const ROWS: usize = 32;
/// Behind the surface, from this share of the truncation on, a frame's word counts less and less: what it sees there may
/// be another side of something thin.
const FULL_BEHIND: f32 = 0.25;

impl Volume {
    /// Adds one frame: to each voxel near what it sees, the distance along the surface's normal (B. Curless, M. Levoy, *A
    /// Volumetric Method for Building Complex Models from Range Images*, SIGGRAPH 1996).
    pub(super) fn add(&mut self, frame: &Measured, progress: &Progress) -> Result<(), Stopped> {
        self.frames += 1;
        let places = self.near(frame);
        progress.check()?;
        let number = self.frames;
        self.touch(&places, number);
        let (origin, voxel, truncation) = (self.origin, self.options.voxel, self.truncation());
        self.blocks.par_iter_mut().filter(|block| block.frame == number).for_each(|block| {
            let corner = origin + block.place.as_dvec3() * (EDGE as f64 * voxel);
            Sight::new(frame, corner, voxel, truncation).update(block);
        });
        progress.check()
    }

    /// The places of all blocks within the truncation of what a frame sees, in order.
    fn near(&self, frame: &Measured) -> Vec<IVec3> {
        let world_from_camera = frame.rotation.transpose();
        let centre = (world_from_camera * -frame.translation - self.origin) / self.options.voxel;
        let grid_from_camera = (world_from_camera * (1.0 / self.options.voxel)).as_mat3();
        let (centre, reach) = (centre.as_vec3(), self.truncation());
        let rows = |first: usize| {
            let mut places: Vec<IVec3> = Vec::new();
            let mut last = (IVec3::MAX, IVec3::MAX);
            for y in first..(first + ROWS).min(frame.height) {
                for x in 0..frame.width {
                    let pixel = frame.pixels[y * frame.width + x];
                    if pixel.depth <= 0.0 || !pixel.wanted {
                        continue;
                    }
                    let ray = (Vec2::new(x as f32, y as f32) + 0.5 - frame.principal) / frame.focal;
                    let surface = centre + grid_from_camera * (ray.extend(1.0) * pixel.depth);
                    let along = grid_from_camera * (ray.extend(1.0).normalize() * reach);
                    let around = blocks_around(surface, along.abs() + 1.0);
                    // Most pixels see the block that the one before saw.
                    if around != last {
                        add_blocks(around, &mut places);
                        last = around;
                    }
                }
            }
            places.sort_unstable_by_key(IVec3::to_array);
            places.dedup();
            places
        };
        let firsts: Vec<usize> = (0..frame.height).step_by(ROWS).collect();
        let mut places: Vec<IVec3> = firsts.into_par_iter().flat_map_iter(rows).collect();
        places.par_sort_unstable_by_key(IVec3::to_array);
        places.dedup();
        places
    }
}

/// The first and the last of the blocks within `reach` voxels of a point, in voxels, along each axis.
fn blocks_around(point: Vec3, reach: Vec3) -> (IVec3, IVec3) {
    // Rounding down by hand: without the processor's own instruction `floor` is a call for every number.
    let block = |at: Vec3| {
        let whole = (at / EDGE as f32).as_ivec3();
        whole - IVec3::from(whole.as_vec3().cmpgt(at / EDGE as f32))
    };
    (block(point - reach), block(point + reach))
}

fn add_blocks((first, last): (IVec3, IVec3), places: &mut Vec<IVec3>) {
    for z in first.z..=last.z {
        for y in first.y..=last.y {
            places.extend((first.x..=last.x).map(|x| IVec3::new(x, y, z)));
        }
    }
}

/// A block as one frame sees it.
struct Sight<'a> {
    frame: &'a Measured,
    /// The block's first voxel in camera space, and the steps to the next in x, y, z.
    corner: Vec3,
    steps: [Vec3; 3],
    truncation: f32,
}

impl<'a> Sight<'a> {
    fn new(frame: &'a Measured, corner: DVec3, voxel: f64, truncation: f32) -> Self {
        let corner = (frame.rotation * corner + frame.translation).as_vec3();
        let axes = [frame.rotation.x_axis, frame.rotation.y_axis, frame.rotation.z_axis];
        Self { frame, corner, steps: axes.map(|axis| (axis * voxel).as_vec3()), truncation }
    }

    fn update(&self, block: &mut Block) {
        for z in 0..EDGE {
            for y in 0..EDGE {
                let first = self.corner + self.steps[1] * y as f32 + self.steps[2] * z as f32;
                let (pixels, depths) = self.row(first);
                for (x, (pixel, depth)) in pixels.into_iter().zip(depths).enumerate() {
                    if let Some(at) = pixel {
                        self.update_voxel(block, voxel_at(x, y, z), &self.frame.pixels[at], depth);
                    }
                }
            }
        }
    }

    /// The pixels that see the eight voxels of a row, and the voxels' depths.
    fn row(&self, first: Vec3) -> ([Option<usize>; EDGE], [f32; EDGE]) {
        let ramp = f32x8::new([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
        let along = |first: f32, step: f32| f32x8::splat(first) + ramp * f32x8::splat(step);
        let [x, y, z] = [0, 1, 2].map(|axis| along(first[axis], self.steps[0][axis]));
        let inverse = f32x8::splat(1.0) / z;
        let (focal, principal) = (self.frame.focal, self.frame.principal);
        let column = (x * inverse * f32x8::splat(focal.x) + f32x8::splat(principal.x)).to_array();
        let row = (y * inverse * f32x8::splat(focal.y) + f32x8::splat(principal.y)).to_array();
        let depths = z.to_array();
        let (width, height) = (self.frame.width, self.frame.height);
        let pixels = std::array::from_fn(|lane| {
            let seen = depths[lane] > 0.0
                && column[lane] >= 0.0
                && row[lane] >= 0.0
                && column[lane] < width as f32
                && row[lane] < height as f32;
            seen.then(|| row[lane] as usize * width + column[lane] as usize)
        });
        (pixels, depths)
    }

    fn update_voxel(&self, block: &mut Block, voxel: usize, pixel: &Pixel, depth: f32) {
        if pixel.depth <= 0.0 {
            return;
        }
        let distance = (pixel.depth - depth) * pixel.slant / self.truncation;
        if distance < -1.0 {
            return;
        }
        let behind = ((1.0 + distance) / (1.0 - FULL_BEHIND)).min(1.0).powi(2);
        let weight = pixel.weight * behind;
        if weight > 0.0 {
            block.update(voxel, distance, weight, pixel);
        }
    }
}

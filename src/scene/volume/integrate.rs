use glam::{DVec3, IVec3, Vec2, Vec3};
use rayon::prelude::*;
use wide::f32x8;

use super::block::{Block, EDGE, ROWS, Said};
use super::blocks::Volume;
use super::measured::{Measured, Pixel};
use crate::engine::job::{Progress, Stopped};

/// Rows of pixels that one task looks at for blocks near what they see.
const BAND: usize = 32;
/// Blocks found lately that are remembered, so that few are found again.
const RECENT: usize = 1 << 12;
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
            let mut places = Places::new();
            let mut last = (IVec3::MAX, IVec3::MAX);
            for y in first..(first + BAND).min(frame.height) {
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
                        places.add(around);
                        last = around;
                    }
                }
            }
            places.found
        };
        let firsts: Vec<usize> = (0..frame.height).step_by(BAND).collect();
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

/// Places of blocks, nearly each of them once.
struct Places {
    found: Vec<IVec3>,
    /// The last one found among those that share a few bits.
    recent: Vec<IVec3>,
}

impl Places {
    fn new() -> Self {
        Self { found: Vec::new(), recent: vec![IVec3::MAX; RECENT] }
    }

    fn add(&mut self, (first, last): (IVec3, IVec3)) {
        for z in first.z..=last.z {
            for y in first.y..=last.y {
                for x in first.x..=last.x {
                    let place = IVec3::new(x, y, z);
                    let recent = &mut self.recent[(x ^ y << 4 ^ z << 8) as usize % RECENT];
                    if *recent != place {
                        *recent = place;
                        self.found.push(place);
                    }
                }
            }
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
        for row in 0..ROWS {
            let first = self.corner + self.steps[1] * (row % EDGE) as f32 + self.steps[2] * (row / EDGE) as f32;
            if let Some(said) = self.row(first) {
                block.update(row, &said);
            }
        }
    }

    /// What the frame says of the voxels of the row that begins here, in camera space.
    fn row(&self, first: Vec3) -> Option<Said<'a>> {
        let ramp = f32x8::new([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
        let along = |first: f32, step: f32| f32x8::splat(first) + ramp * f32x8::splat(step);
        let [x, y, z] = [0, 1, 2].map(|axis| along(first[axis], self.steps[0][axis]));
        let inverse = f32x8::ONE / z;
        let (focal, principal) = (self.frame.focal, self.frame.principal);
        let column = x * inverse * f32x8::splat(focal.x) + f32x8::splat(principal.x);
        let row = y * inverse * f32x8::splat(focal.y) + f32x8::splat(principal.y);
        let within = |at: f32x8, size: usize| at.simd_ge(f32x8::ZERO) & at.simd_lt(f32x8::splat(size as f32));
        let is_seen = z.simd_gt(f32x8::ZERO) & within(column, self.frame.width) & within(row, self.frame.height);
        if !is_seen.any() {
            return None;
        }
        let (column, row) =
            ((column & is_seen).fast_trunc_int().to_array(), (row & is_seen).fast_trunc_int().to_array());
        let pixels: [&Pixel; EDGE] = std::array::from_fn(|lane| {
            &self.frame.pixels[row[lane] as usize * self.frame.width + column[lane] as usize]
        });
        let (mut depth, mut slant, mut weight) = ([0.0; EDGE], [0.0; EDGE], [0.0; EDGE]);
        for (lane, pixel) in pixels.iter().enumerate() {
            (depth[lane], slant[lane], weight[lane]) = (pixel.depth, pixel.slant, pixel.weight);
        }
        let (depth, slant, weight) = (f32x8::new(depth), f32x8::new(slant), f32x8::new(weight));
        let distance = (depth - z) * slant * f32x8::splat(1.0 / self.truncation);
        let of = is_seen & depth.simd_gt(f32x8::ZERO) & distance.simd_gt(-f32x8::ONE);
        if !of.any() {
            return None;
        }
        let behind = ((f32x8::ONE + distance) * f32x8::splat(1.0 / (1.0 - FULL_BEHIND))).fast_min(f32x8::ONE);
        Some(Said { of, distance: distance.fast_min(f32x8::ONE), weight: weight * behind * behind, pixels })
    }
}

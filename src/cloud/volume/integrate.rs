use glam::{DVec3, IVec3, Mat3, Vec2, Vec3};
use rayon::prelude::*;
use wide::{f32x8, i32x8};

use super::block::{EDGE, ROWS, RowUpdate, VoxelBlock, lanes_in};
use super::frame_measurements::{FrameMeasurements, SurfacePixel};
use super::sparse_volume::Volume;
use ostra_core::job::{Progress, Stopped};

/// Number of values in a SIMD vector.
const LANES: usize = 8;
/// Indices of the lanes of a vector.
const RAMP: f32x8 = f32x8::new([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
/// Edge length in pixels of an image tile that fits into the cache of a core.
///
/// 64 × 64 pixels of 20 bytes are 80 KiB.
const TILE: u32 = 64;
/// Number of pixel rows that one task searches for nearby blocks.
const BAND: usize = 32;
/// Number of recently found blocks that are remembered, to avoid most duplicates.
const RECENT: usize = 1 << 12;
/// Share of the truncation behind the surface from which the weight of a frame decreases.
///
/// The space behind the surface may be in front of another side of a thin object.
const FULL_BEHIND: f32 = 0.25;

impl Volume {
    /// Adds one frame to the volume.
    ///
    /// Each voxel near the visible surface receives its distance along the surface normal (B.
    /// Curless, M. Levoy, *A Volumetric Method for Building Complex Models from Range Images*,
    /// SIGGRAPH 1996).
    pub(super) fn add(
        &mut self,
        frame: &FrameMeasurements,
        progress: &Progress,
    ) -> Result<(), Stopped> {
        self.frames += 1;
        let places = self.near(frame);
        progress.check()?;
        let number = self.frames;
        self.touch(&places, number);
        let (origin, voxel, truncation) = (self.origin, self.options.voxel, self.truncation());
        let sight = |block: &VoxelBlock| {
            let corner = origin + block.place.as_dvec3() * (EDGE as f64 * voxel);
            BlockView::new(frame, corner, voxel, truncation)
        };
        let mut seen: Vec<(BlockView<'_>, &mut VoxelBlock)> = self
            .blocks
            .iter_mut()
            .filter(|block| block.frame == number)
            .map(|block| (sight(block), block))
            .collect();
        // The pixels of a whole image do not fit into the cache of a core, so blocks in front of
        // the same pixels are processed together.
        seen.par_sort_unstable_by_key(|(sight, block)| (sight.tile(), block.place.to_array()));
        seen.into_par_iter()
            .for_each(|(sight, block)| sight.update(block));
        progress.check()
    }

    /// Returns the positions of all blocks within the truncation of a frame's surface, in order.
    fn near(&self, frame: &FrameMeasurements) -> Vec<IVec3> {
        let world_from_camera = frame.rotation.transpose();
        let centre = (world_from_camera * -frame.translation - self.origin) / self.options.voxel;
        let near = NearBlocks {
            frame,
            centre: centre.as_vec3(),
            grid_from_camera: (world_from_camera * (1.0 / self.options.voxel)).as_mat3(),
            reach: self.truncation(),
        };
        let rows = |first: usize| {
            let mut places = BlockPositions::new();
            for y in first..(first + BAND).min(frame.height) {
                near.row(y, &mut places);
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

/// Finds the blocks near the surface that a frame sees.
struct NearBlocks<'a> {
    frame: &'a FrameMeasurements,
    /// The camera centre, in voxels.
    centre: Vec3,
    /// Rotation from camera space, divided by the voxel size.
    grid_from_camera: Mat3,
    /// Distance along a ray in front of and behind a surface, in world units.
    reach: f32,
}

impl NearBlocks<'_> {
    /// Adds the blocks near the surface that the pixels of a row see.
    fn row(&self, y: usize, places: &mut BlockPositions) {
        let FrameMeasurements {
            width,
            focal,
            principal,
            ..
        } = *self.frame;
        let pixels = &self.frame.pixels[y * width..(y + 1) * width];
        let ray_y = f32x8::splat((y as f32 + 0.5 - principal.y) / focal.y);
        for (pixels, first) in pixels.chunks(LANES).zip((0..).step_by(LANES)) {
            let mut depth = [0.0; LANES];
            for (depth, pixel) in depth.iter_mut().zip(pixels) {
                *depth = if pixel.wanted { pixel.depth } else { 0.0 };
            }
            let is_seen = f32x8::new(depth).simd_gt(f32x8::ZERO).to_bitmask();
            if is_seen == 0 {
                continue;
            }
            let columns = f32x8::splat(first as f32 + 0.5 - principal.x) + RAMP;
            let ray = [columns * f32x8::splat(1.0 / focal.x), ray_y];
            let [low, high] = self.blocks(ray, f32x8::new(depth));
            for lane in lanes_in(is_seen) {
                let block = |ends: &[[i32; LANES]; 3]| IVec3::from_array(ends.map(|end| end[lane]));
                places.add(block(&low), block(&high));
            }
        }
    }

    /// Returns the first and the last block along each axis near the surfaces at these depths.
    fn blocks(&self, [x, y]: [f32x8; 2], depth: f32x8) -> [[[i32; LANES]; 3]; 2] {
        let reach = f32x8::splat(self.reach) / (x * x + y * y + f32x8::ONE).sqrt();
        let mut blocks = [[[0; LANES]; 3]; 2];
        for axis in 0..3 {
            let row = self.grid_from_camera.row(axis);
            let direction = x * f32x8::splat(row.x) + y * f32x8::splat(row.y) + f32x8::splat(row.z);
            let surface = direction * depth + f32x8::splat(self.centre[axis]);
            let around = (direction * reach).abs() + f32x8::ONE;
            for (end, blocks) in [surface - around, surface + around]
                .into_iter()
                .zip(&mut blocks)
            {
                blocks[axis] = floor(end * f32x8::splat(1.0 / EDGE as f32));
            }
        }
        blocks
    }
}

/// Rounds down.
///
/// Without the processor's own instruction, `floor` is a function call per number.
fn floor(at: f32x8) -> [i32; LANES] {
    let whole = at.fast_trunc_int();
    // A true comparison is −1 as an integer.
    let above: i32x8 = bytemuck::cast(whole.round_float().simd_gt(at));
    (whole + above).to_array()
}

/// Positions of blocks, with few duplicates.
struct BlockPositions {
    found: Vec<IVec3>,
    /// The range added last. Most pixels see the same blocks as the previous pixel.
    last: (IVec3, IVec3),
    /// The last block found for each hash of a few bits of its position.
    recent: Vec<IVec3>,
}

impl BlockPositions {
    fn new() -> Self {
        Self {
            found: Vec::new(),
            last: (IVec3::MAX, IVec3::MAX),
            recent: vec![IVec3::MAX; RECENT],
        }
    }

    /// Adds the blocks from the first to the last one along each axis.
    fn add(&mut self, first: IVec3, last: IVec3) {
        if self.last == (first, last) {
            return;
        }
        self.last = (first, last);
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

/// A block in the camera space of one frame.
struct BlockView<'a> {
    frame: &'a FrameMeasurements,
    /// The first voxel of the block in camera space; `steps` lead to the next one in x, y and z.
    corner: Vec3,
    steps: [Vec3; 3],
    truncation: f32,
}

impl<'a> BlockView<'a> {
    fn new(frame: &'a FrameMeasurements, corner: DVec3, voxel: f64, truncation: f32) -> Self {
        let corner = (frame.rotation * corner + frame.translation).as_vec3();
        let axes = [
            frame.rotation.x_axis,
            frame.rotation.y_axis,
            frame.rotation.z_axis,
        ];
        Self {
            frame,
            corner,
            steps: axes.map(|axis| (axis * voxel).as_vec3()),
            truncation,
        }
    }

    /// Returns the image tile that sees the centre of the block, counted in rows.
    ///
    /// Blocks outside the image count as part of its border tiles.
    fn tile(&self) -> u32 {
        let half = EDGE as f32 / 2.0;
        let centre = self.corner + (self.steps[0] + self.steps[1] + self.steps[2]) * half;
        let at_px = centre.truncate() / centre.z * self.frame.focal + self.frame.principal;
        let last = Vec2::new(self.frame.width as f32, self.frame.height as f32);
        // The conversion saturates and turns NaN into 0.
        let tile = |at: f32, last: f32| at.min(last) as u32 / TILE;
        tile(at_px.y, last.y) * (self.frame.width as u32 / TILE + 1) + tile(at_px.x, last.x)
    }

    fn update(&self, block: &mut VoxelBlock) {
        for row in 0..ROWS {
            let first = self.corner
                + self.steps[1] * (row % EDGE) as f32
                + self.steps[2] * (row / EDGE) as f32;
            if let Some(update_row) = self.row(first) {
                block.update(row, &update_row);
            }
        }
    }

    /// Returns the frame's measurements of a row of voxels.
    ///
    /// The row starts at `first` in camera space.
    fn row(&self, first: Vec3) -> Option<RowUpdate<'a>> {
        let along = |first: f32, step: f32| f32x8::splat(first) + RAMP * f32x8::splat(step);
        let [x, y, z] = [0, 1, 2].map(|axis| along(first[axis], self.steps[0][axis]));
        let inverse = f32x8::ONE / z;
        let (focal, principal) = (self.frame.focal, self.frame.principal);
        let column = x * inverse * f32x8::splat(focal.x) + f32x8::splat(principal.x);
        let row = y * inverse * f32x8::splat(focal.y) + f32x8::splat(principal.y);
        let within = |at: f32x8, size: usize| {
            at.simd_ge(f32x8::ZERO) & at.simd_lt(f32x8::splat(size as f32))
        };
        let is_seen = z.simd_gt(f32x8::ZERO)
            & within(column, self.frame.width)
            & within(row, self.frame.height);
        if !is_seen.any() {
            return None;
        }
        let (column, row) = (
            (column & is_seen).fast_trunc_int().to_array(),
            (row & is_seen).fast_trunc_int().to_array(),
        );
        let pixels: [&SurfacePixel; EDGE] = std::array::from_fn(|lane| {
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
        let behind = ((f32x8::ONE + distance) * f32x8::splat(1.0 / (1.0 - FULL_BEHIND)))
            .fast_min(f32x8::ONE);
        Some(RowUpdate {
            of,
            distance: distance.fast_min(f32x8::ONE),
            weight: weight * behind * behind,
            pixels,
        })
    }
}

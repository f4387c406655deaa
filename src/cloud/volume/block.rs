//! Blocks of voxels, and the signs of their distances.

use glam::{IVec3, Vec3};
use wide::f32x8;

use super::frame_measurements::{Facing, SurfacePixel};

/// Number of voxels along an edge of a block.
pub(super) const EDGE: usize = 8;
/// Number of voxel rows in a block.
pub(super) const ROWS: usize = EDGE * EDGE;
/// Cap on the sum of weights, which keeps the mean from changing ever more slowly.
const MOST_WEIGHT: f32 = 255.0;
/// Weight factor of a frame that sees far past a voxel.
///
/// At the rim of a thin object, half a pixel decides whether a frame does.
const PAST: f32 = 0.05;
/// Ratio of visibility between the two layers of a voxel above which the worse one is ignored.
const FAR_WORSE: u8 = 4;
/// Number of steps of the share of a colour in its mean.
const SHARES: f32 = 32768.0;

/// A cube of voxels in memory order x, then y, then z, where each voxel has up to two layers.
///
/// A voxel is a sample at its lower corner. Two layers are needed because a thin sheet is seen from
/// both sides, and the space in front of it from one side is behind it from the other. This follows
/// M. Splietker, S. Behnke, *Directional TSDF: Modeling Surface Orientation for Coherent Meshes*,
/// IROS 2019, but with two sides per voxel instead of six in all.
#[derive(Debug)]
pub(super) struct VoxelBlock {
    /// Position of the block, in blocks from the volume's origin.
    pub(super) place: IVec3,
    /// The number of the last frame that came near the block.
    pub(super) frame: u32,
    first: Box<Layer>,
    /// Allocated where a surface is seen from two sides.
    second: Option<Box<Layer>>,
}

/// One side of the surfaces near the samples of a block.
#[derive(Debug, Clone)]
struct Layer {
    rows: [VoxelRow; ROWS],
}

/// The samples of a row.
#[derive(Debug, Clone, Copy)]
struct VoxelRow {
    /// Signed distance from the surface in truncations, averaged over frames.
    ///
    /// It ranges from −1 (behind) to 1 (in front).
    distance: [f32; EDGE],
    /// Sum of the frames' weights; 0 is unseen.
    weight: [f32; EDGE],
    /// Mean colour in sRGB, in steps of 1/256 of a channel unit.
    color: [[u16; 3]; EDGE],
    /// The normal from the frame with the best view of the sample.
    normal: [Facing; EDGE],
    /// The `sight` of that frame's pixel, in steps of 1/255.
    sight: [u8; EDGE],
}

/// One side of a surface near a sample.
#[derive(Debug, Clone, Copy)]
pub(super) struct TsdfVoxel {
    /// Signed distance from the surface in truncations, −1 (behind) to 1 (in front).
    pub(super) distance: f32,
    /// Sum of the frames' weights, above 0.
    pub(super) weight: f32,
    /// Normal towards the frames that saw the surface.
    pub(super) normal: Facing,
    /// Colour in sRGB, in steps of 1/256 of a channel unit.
    pub(super) color: [u16; 3],
}

/// A frame's measurements of the voxels of a row.
pub(super) struct RowUpdate<'a> {
    /// Mask of the measured voxels: all bits set.
    pub(super) of: f32x8,
    /// Signed distance from the surface in truncations, −1 to 1; 1 is far in front of it.
    pub(super) distance: f32x8,
    pub(super) weight: f32x8,
    /// The pixel that sees each voxel.
    pub(super) pixels: [&'a SurfacePixel; EDGE],
}

impl TsdfVoxel {
    /// Returns the colour in sRGB.
    pub(super) fn color(&self) -> Vec3 {
        Vec3::from_array(self.color.map(f32::from)) / 256.0
    }
}

impl VoxelBlock {
    /// Size in bytes of a block with one layer.
    pub(super) const BYTES: usize = size_of::<Self>() + size_of::<Layer>();

    pub(super) fn new(place: IVec3) -> Self {
        Self {
            place,
            frame: 0,
            first: Layer::new(),
            second: None,
        }
    }

    /// Returns the layers of a voxel that are sides of a surface.
    ///
    /// If one layer was seen well, the other one is ignored if it was only seen from its rim.
    pub(super) fn sides(&self, voxel: usize) -> [Option<TsdfVoxel>; 2] {
        let (first, first_sight) = self.first.at(voxel);
        let Some(second) = &self.second else {
            return [first, None];
        };
        let (second, second_sight) = second.at(voxel);
        let best = first_sight.max(second_sight) / FAR_WORSE;
        [
            first.filter(|_| first_sight >= best),
            second.filter(|_| second_sight >= best),
        ]
    }

    /// Returns the side of the surface that each sample is on.
    pub(super) fn signs(&self) -> Signs {
        let mut signs = Signs {
            behind: [0; ROWS],
            before: [0; ROWS],
        };
        for layer in [Some(&self.first), self.second.as_ref()]
            .into_iter()
            .flatten()
        {
            for (row, at) in layer.rows.iter().zip(0..) {
                let seen = f32x8::new(row.weight).simd_gt(f32x8::ZERO);
                let distance = f32x8::new(row.distance);
                signs.behind[at] |= (seen & distance.simd_lt(f32x8::ZERO)).to_bitmask() as u8;
                signs.before[at] |= (seen & distance.simd_ge(f32x8::ZERO)).to_bitmask() as u8;
            }
        }
        signs
    }

    /// Adds a frame's measurements of the voxels of a row.
    pub(super) fn update(&mut self, row: usize, update_row: &RowUpdate<'_>) {
        let past = update_row.of & update_row.distance.simd_ge(f32x8::ONE);
        let near = update_row.of & update_row.distance.simd_lt(f32x8::ONE);
        let of_second = self.of_second(row, near.to_bitmask(), update_row);
        self.first.rows[row].update(near & of_second.simd_eq(f32x8::ZERO), past, update_row);
        let of_second = of_second.simd_gt(f32x8::ZERO);
        if of_second.any() {
            self.second.get_or_insert_with(Layer::new).rows[row]
                .update(of_second, past, update_row);
        } else if let Some(second) = &mut self.second {
            second.rows[row].update(f32x8::ZERO, past, update_row);
        }
    }

    /// Returns 1 in the lanes whose pixels see the side of the second layer, otherwise 0.
    ///
    /// Only the given lanes are examined.
    fn of_second(&self, row: usize, lanes: u32, update_row: &RowUpdate<'_>) -> f32x8 {
        let mut of_second = [0.0; EDGE];
        let first = &self.first.rows[row];
        let second = self.second.as_ref().map(|layer| &layer.rows[row]);
        for lane in lanes_in(lanes) {
            let normal = update_row.pixels[lane].normal;
            if first.weight[lane] > 0.0 {
                let other = second
                    .filter(|row| row.weight[lane] > 0.0)
                    .map(|row| row.normal[lane].dot(normal));
                let is_second = first.normal[lane].dot(normal) < other.unwrap_or(Facing::SAME_SIDE);
                of_second[lane] = f32::from(u8::from(is_second));
            }
        }
        f32x8::new(of_second)
    }

    /// Returns the size of the block in bytes.
    pub(super) fn bytes(&self) -> usize {
        size_of::<Self>() + (1 + usize::from(self.second.is_some())) * size_of::<Layer>()
    }
}

impl Layer {
    fn new() -> Box<Self> {
        const UNSEEN: VoxelRow = VoxelRow {
            distance: [0.0; EDGE],
            weight: [0.0; EDGE],
            color: [[0; 3]; EDGE],
            normal: [Facing::NONE; EDGE],
            sight: [0; EDGE],
        };
        Box::new(Self {
            rows: [UNSEEN; ROWS],
        })
    }

    /// Returns a voxel, if it was seen, and how well it was seen.
    fn at(&self, voxel: usize) -> (Option<TsdfVoxel>, u8) {
        let (row, x) = (&self.rows[voxel / EDGE], voxel % EDGE);
        if row.weight[x] <= 0.0 {
            return (None, 0);
        }
        let (distance, weight, normal, color) =
            (row.distance[x], row.weight[x], row.normal[x], row.color[x]);
        (
            Some(TsdfVoxel {
                distance,
                weight,
                normal,
                color,
            }),
            row.sight[x],
        )
    }
}

impl VoxelRow {
    /// Adds the measurements of the lanes `near` to this side.
    ///
    /// Lanes in `past` move away from the surface if it was seen there.
    fn update(&mut self, near: f32x8, past: f32x8, update_row: &RowUpdate<'_>) {
        let old = f32x8::new(self.weight);
        let past = past & old.simd_gt(f32x8::ZERO);
        let changed = near | past;
        if !changed.any() {
            return;
        }
        let weight =
            changed & past.bitselect(update_row.weight * f32x8::splat(PAST), update_row.weight);
        let sum = old + weight;
        let share = weight / sum.fast_max(f32x8::splat(f32::MIN_POSITIVE));
        let distance = f32x8::new(self.distance);
        self.distance = (distance + (update_row.distance - distance) * share).to_array();
        self.weight = sum.fast_min(f32x8::splat(MOST_WEIGHT)).to_array();
        let lanes = near.to_bitmask();
        if lanes != 0 {
            let shares = (share * f32x8::splat(SHARES)).fast_round_int().to_array();
            for lane in lanes_in(lanes) {
                self.see(lane, update_row.pixels[lane], shares[lane]);
            }
        }
    }

    /// Blends in a share of a pixel's colour, and takes its normal if it has the best view so far.
    fn see(&mut self, lane: usize, pixel: &SurfacePixel, share: i32) {
        for (mean, new) in self.color[lane].iter_mut().zip(pixel.color) {
            let change = (i32::from(new) << 8) - i32::from(*mean);
            *mean = (i32::from(*mean) + ((change * share + (1 << 14)) >> 15)) as u16;
        }
        if pixel.sight > self.sight[lane] {
            (self.normal[lane], self.sight[lane]) = (pixel.normal, pixel.sight);
        }
    }
}

/// Returns the indices of the set bits.
pub(super) fn lanes_in(mut bits: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lane = (bits != 0).then(|| bits.trailing_zeros() as usize);
        bits &= bits.wrapping_sub(1);
        lane
    })
}

/// Returns the index of a voxel within its block.
pub(super) const fn voxel_at(x: usize, y: usize, z: usize) -> usize {
    (z * EDGE + y) * EDGE + x
}

/// Number of samples along an edge of a block and its cells.
///
/// It includes those of the next block that the cells need.
const SPAN: usize = EDGE + 1;

/// The samples of a block that some layer has behind or in front of a surface, one bit per sample.
#[derive(Debug, Clone, Copy)]
pub(super) struct Signs {
    behind: [u8; ROWS],
    before: [u8; ROWS],
}

/// The signs of a block and of the first samples of the blocks after it.
pub(super) struct SignsAround {
    behind: [u16; SPAN * SPAN],
    before: [u16; SPAN * SPAN],
}

impl SignsAround {
    /// Combines the signs of a block and of those after it, ordered by the number of their corner.
    pub(super) fn new(around: [Option<&Signs>; 8]) -> Self {
        let mut signs = Self {
            behind: [0; SPAN * SPAN],
            before: [0; SPAN * SPAN],
        };
        for row in 0..SPAN * SPAN {
            let (y, z) = (row % SPAN, row / SPAN);
            let block = (y / EDGE) << 1 | (z / EDGE) << 2;
            let at = (z % EDGE) * EDGE + y % EDGE;
            if let Some(here) = around[block] {
                signs.behind[row] = u16::from(here.behind[at]);
                signs.before[row] = u16::from(here.before[at]);
            }
            if let Some(next) = around[block | 1] {
                signs.behind[row] |= u16::from(next.behind[at] & 1) << EDGE;
                signs.before[row] |= u16::from(next.before[at] & 1) << EDGE;
            }
        }
        signs
    }

    /// Returns the samples of a row that may have a surface crossing, along x, y and z.
    ///
    /// The crossing is between the sample and the next one along the axis.
    pub(super) fn edges(&self, row: usize) -> [u8; 3] {
        let at = row / EDGE * SPAN + row % EDGE;
        let (behind, before) = (self.behind[at], self.before[at]);
        let crossing = |(next_behind, next_before): (u16, u16)| {
            (behind & next_before | before & next_behind) as u8
        };
        let next_row = |step: usize| (self.behind[at + step], self.before[at + step]);
        [(behind >> 1, before >> 1), next_row(1), next_row(SPAN)].map(crossing)
    }

    /// Returns the cells of a row that a surface may cross.
    ///
    /// All corners of such a cell were seen, on both sides of the surface.
    pub(super) fn cells(&self, row: usize) -> u8 {
        let at = row / EDGE * SPAN + row % EDGE;
        let rows = [at, at + 1, at + SPAN, at + SPAN + 1];
        let behind = rows.iter().fold(0, |all, &row| all | self.behind[row]);
        let before = rows.iter().fold(0, |all, &row| all | self.before[row]);
        let seen = rows.iter().fold(u16::MAX, |all, &row| {
            all & (self.behind[row] | self.before[row])
        });
        ((behind | behind >> 1) & (before | before >> 1) & seen & seen >> 1) as u8
    }
}

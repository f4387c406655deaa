//! The voxels of the grid and their keys, in sharded hash maps.

#![expect(
    clippy::disallowed_types,
    reason = "look-ups alone; their order reaches no result"
)]

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use glam::{DVec3, Vec3};

/// The placement of a voxel grid in world space.
#[derive(Debug, Clone, Copy)]
pub(super) struct GridFrame {
    /// The corner of the first voxel.
    pub(super) origin: DVec3,
    /// Edge length of a voxel.
    pub(super) voxel: f64,
}

/// Number of steps per voxel edge in which positions are summed.
pub(super) const FRACTION: f32 = 4096.0;

/// Number of steps per unit in which normal components are summed.
const NORMAL_STEPS: f32 = 1024.0;

/// Extent of the grid from the origin in each direction, in voxels.
pub(crate) const GRID_REACH: i32 = 1 << 20;

/// Bit positions of the x, y and z indices in a key.
pub(super) const AXIS_SHIFTS: [u32; 3] = [42, 21, 0];

/// A voxel index and the position within that voxel, in 1/4096 of its edge.
#[derive(Debug, Clone, Copy)]
pub(super) struct VoxelPosition {
    pub(super) index: [i32; 3],
    pub(super) fraction: [u16; 3],
}

/// One pixel unprojected to 3-D.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    pub(super) key: u64,
    pub(super) fraction: [u16; 3],
    pub(super) normal: [i16; 3],
    pub(super) color: [u8; 3],
}

/// Sums over the samples of one voxel.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct VoxelSums {
    pub(super) fraction: [i32; 3],
    pub(super) color: [u32; 3],
    pub(super) normal: [i32; 3],
    pub(super) samples: u32,
    pub(super) views: u32,
    pub(super) last_frame: u32,
}

impl VoxelPosition {
    /// Returns the cell that contains a point in grid units, or `None` outside the grid.
    pub(super) fn holding(in_grid: Vec3) -> Option<Self> {
        if !in_grid
            .abs()
            .cmplt(Vec3::splat(GRID_REACH as f32 - 1.0))
            .all()
        {
            return None;
        }
        // Without the processor's own instruction, `floor` is a function call per number.
        let index = in_grid.to_array().map(|at| {
            let whole = at as i32;
            whole - i32::from(whole as f32 > at)
        });
        let fraction = (in_grid - glam::IVec3::from_array(index).as_vec3()) * FRACTION;
        Some(Self {
            index,
            fraction: fraction.to_array().map(|f| f as u16),
        })
    }
}

impl Sample {
    pub(super) fn new(key: u64, fraction: [u16; 3], color: [u8; 3], normal: Vec3) -> Self {
        Self {
            key,
            fraction,
            color,
            normal: (normal * NORMAL_STEPS).to_array().map(|n| n as i16),
        }
    }
}

/// Packs a voxel index into one number, with 21 bits per axis.
pub(super) fn cell_key(index: [i32; 3]) -> u64 {
    index
        .iter()
        .fold(0, |key, &i| key << 21 | (i + GRID_REACH) as u64)
}

impl VoxelSums {
    pub(super) fn mean_normal(&self) -> Vec3 {
        Vec3::from_array(self.normal.map(|n| n as f32)).normalize_or_zero()
    }
}

pub(super) fn cell_index(key: u64) -> DVec3 {
    DVec3::from_array(
        AXIS_SHIFTS.map(|shift| f64::from((key >> shift & 0x1F_FFFF) as i32 - GRID_REACH)),
    )
}

/// Number of parts of the grid that are filled in parallel.
pub(super) const SHARDS: usize = 32;
/// Base-2 logarithm of the edge length of a block in voxels.
const BLOCK_BITS: u32 = 2;
/// Mask of the bits of a voxel index within its block.
const WITHIN: u64 = (1 << BLOCK_BITS) - 1;
/// An odd number that spreads bits upwards when multiplied: 2⁶⁴ divided by the golden ratio.
const SPREAD: u64 = 0x9E37_79B9_7F4A_7C15;
/// The bits of a hash that a map compares before it compares keys.
const TAG: u64 = 0x7F << 57;

/// Voxels by key, where those of a block of 4 × 4 × 4 are adjacent in memory.
///
/// Adjacent pixels fall into adjacent voxels. A map with a plain hash spends most of its time
/// waiting for memory.
pub(super) type VoxelMap<T = VoxelSums> = HashMap<u64, T, BuildHasherDefault<VoxelHasher>>;

/// Hasher of voxel keys; see [`VoxelMap`].
#[derive(Debug, Default)]
pub(super) struct VoxelHasher(u64);

impl Hasher for VoxelHasher {
    fn write_u64(&mut self, key: u64) {
        let block = block_of(key).wrapping_mul(SPREAD);
        let within = AXIS_SHIFTS.iter().fold(0, |within, &shift| {
            within << BLOCK_BITS | key >> shift & WITHIN
        });
        let place = (block ^ block >> 32) << (3 * BLOCK_BITS) | within;
        self.0 = place & !TAG | key.wrapping_mul(SPREAD) & TAG;
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes
            .iter()
            .for_each(|&byte| self.write_u64(self.0 << 8 | u64::from(byte)));
    }

    fn finish(&self) -> u64 {
        self.0
    }
}

/// Returns the key of the first voxel of a block.
fn block_of(key: u64) -> u64 {
    AXIS_SHIFTS
        .iter()
        .fold(key, |key, &shift| key & !(WITHIN << shift))
}

/// Returns the shard that holds a voxel, which is that of its block.
pub(super) fn shard_of(key: u64) -> usize {
    (block_of(key).wrapping_mul(SPREAD) >> 59) as usize % SHARDS
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::hash::BuildHasher;

    use super::*;

    #[test]
    fn voxels_of_a_block_are_adjacent_in_memory() {
        let hasher = BuildHasherDefault::<VoxelHasher>::default();
        let place = |key: u64| hasher.hash_one(key) & !TAG;
        let block = |corner: [i32; 3]| -> Vec<u64> {
            let within = |at: i32| {
                [
                    corner[0] + (at & 3),
                    corner[1] + (at >> 2 & 3),
                    corner[2] + (at >> 4),
                ]
            };
            (0..64).map(|at| cell_key(within(at))).collect()
        };
        let mut blocks = BTreeSet::new();
        for corner in [[0, 0, 0], [4, 0, 0], [-4, 8, 12], [400, -800, 1200]] {
            let keys = block(corner);
            let places: BTreeSet<u64> = keys.iter().map(|&key| place(key)).collect();
            assert_eq!(places.len(), 64);
            assert_eq!(places.last().unwrap() - places.first().unwrap(), 63);
            assert!(keys.iter().all(|&key| shard_of(key) == shard_of(keys[0])));
            blocks.insert(places.first().unwrap() >> 6);
        }
        assert_eq!(blocks.len(), 4);
        let shards: BTreeSet<usize> = (0..200)
            .map(|at| shard_of(cell_key([4 * at, 0, 0])))
            .collect();
        assert_eq!(shards.len(), SHARDS, "all are used");
    }
}

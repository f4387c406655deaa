#![expect(
    clippy::disallowed_types,
    reason = "look-ups alone; their order reaches no result"
)]

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use super::grid::{AXIS_SHIFTS, Voxel};

/// Parts of the grid that are filled side by side.
pub(super) const SHARDS: usize = 32;
/// Voxels along the edge of a block are 2 to the power of this many.
const BLOCK_BITS: u32 = 2;
/// The bits of a voxel's index within its block.
const WITHIN: u64 = (1 << BLOCK_BITS) - 1;
/// An odd number that spreads bits upwards when multiplied: 2⁶⁴ over the golden ratio.
const SPREAD: u64 = 0x9E37_79B9_7F4A_7C15;
/// The bits of a hash that a map compares before it looks at keys.
const TAG: u64 = 0x7F << 57;

/// Voxels by key. Those of a block of 4 × 4 × 4 lie next to each other in memory: pixels next to each other fall into voxels
/// next to each other, and most of the time of a map with a plain hash goes into waiting for memory.
pub(super) type VoxelMap<T = Voxel> = HashMap<u64, T, BuildHasherDefault<VoxelHasher>>;

/// Hashes the keys of voxels; see [`VoxelMap`].
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

/// The key of a block's first voxel.
fn block_of(key: u64) -> u64 {
    AXIS_SHIFTS
        .iter()
        .fold(key, |key, &shift| key & !(WITHIN << shift))
}

/// The shard that a voxel is kept in: that of its block.
pub(super) fn shard_of(key: u64) -> usize {
    (block_of(key).wrapping_mul(SPREAD) >> 59) as usize % SHARDS
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::hash::BuildHasher;

    use super::super::grid::cell_key;
    use super::*;

    #[test]
    fn voxels_of_a_block_are_kept_together_and_blocks_apart() {
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

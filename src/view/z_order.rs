use std::ops::Range;

use glam::Vec3;
use rayon::prelude::*;

use super::Bounds;
use super::points::SpreadOrder;
use ostra_cloud::morton;

/// Points that the grid's place and size are read from.
const SAMPLED: usize = 100_000;

/// Points along a Z-order curve, cut into blocks.
pub(super) struct ZOrder {
    /// Indices of the points.
    pub order: Vec<u32>,
    /// Stretches of [`Self::order`].
    pub blocks: Vec<Range<usize>>,
}

impl ZOrder {
    /// Puts the points that `index` names for `0..count` in order. Blocks have about `size` points, half as many to half as
    /// many again (the last may have fewer): a block ends where the curve jumps farthest, so that it is compact.
    ///
    /// A cell's code and a point's index share 64 bits, so that numbers alone are sorted and the order is the same for any
    /// number of threads.
    pub fn new(
        positions: &[Vec3],
        count: usize,
        index: impl Fn(usize) -> usize + Sync,
        size: usize,
    ) -> Self {
        let index_bits = u64::BITS - (positions.len() as u64).leading_zeros();
        let grid = Grid::over(positions, ((u64::BITS - index_bits) / 3).min(21));
        let key = |place| {
            let index = index(place);
            grid.code(positions[index]) << index_bits | index as u64
        };
        let mut keys: Vec<u64> = (0..count).into_par_iter().map(key).collect();
        keys.par_sort_unstable();
        let of_index = (1 << index_bits) - 1;
        Self {
            blocks: cut(&keys, size),
            order: keys
                .into_par_iter()
                .map(|key| (key & of_index) as u32)
                .collect(),
        }
    }
}

/// Cubes of equal size around where the points are.
struct Grid {
    min: Vec3,
    per_unit: f32,
    last: f32,
}

impl Grid {
    /// Twice as large as where all but a few points lie; strays beyond belong to its outermost cells.
    fn over(positions: &[Vec3], bits: u32) -> Self {
        let order = SpreadOrder::new(positions.len());
        let sampled = (0..positions.len().min(SAMPLED)).map(|place| positions[order.at(place)]);
        let bounds = Bounds::of(sampled).unwrap_or(Bounds {
            min: Vec3::ZERO,
            max: Vec3::ONE,
        });
        let side = (bounds.max - bounds.min)
            .max_element()
            .max(f32::MIN_POSITIVE.sqrt())
            * 2.0;
        let cells = (1_u64 << bits) as f32;
        Self {
            min: bounds.centre() - side / 2.0,
            per_unit: cells / side,
            last: cells - 1.0,
        }
    }

    fn code(&self, x: Vec3) -> u64 {
        let cell = ((x - self.min) * self.per_unit).clamp(Vec3::ZERO, Vec3::splat(self.last));
        morton(cell.to_array().map(|along| along as u64))
    }
}

fn cut(keys: &[u64], size: usize) -> Vec<Range<usize>> {
    let mut blocks = Vec::new();
    let mut begin = 0;
    while begin < keys.len() {
        let ends = begin + size / 2..begin + size * 3 / 2;
        let jump = |&end: &usize| keys[end - 1] ^ keys[end];
        let end = if ends.end < keys.len() {
            ends.max_by_key(jump).unwrap_or(keys.len())
        } else {
            keys.len()
        };
        blocks.push(begin..end);
        begin = end;
    }
    blocks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_point_is_in_one_compact_block_wherever_strays_lie() {
        let mut positions: Vec<Vec3> = (0..40_000)
            .map(|i| Vec3::new((i % 200) as f32, 0.0, (i / 200) as f32) * 0.01)
            .collect();
        positions.extend([Vec3::splat(1e9), Vec3::NEG_X * 1e4, Vec3::NAN]);
        let along = ZOrder::new(&positions, positions.len(), |place| place, 1000);
        let mut seen = along.order.clone();
        seen.sort_unstable();
        assert!(
            seen.into_iter().eq(0..positions.len() as u32),
            "a permutation"
        );
        assert!(
            along
                .blocks
                .iter()
                .flat_map(Clone::clone)
                .eq(0..positions.len()),
            "blocks follow each other"
        );
        let wide = |block: &Range<usize>| {
            let x = || {
                along.order[block.clone()]
                    .iter()
                    .map(|&index| positions[index as usize].x)
            };
            x().fold(0.0, f32::max) - x().fold(f32::MAX, f32::min)
        };
        let compact = along
            .blocks
            .iter()
            .filter(|block| wide(block) < 0.7)
            .count();
        assert!(
            compact * 10 >= along.blocks.len() * 9,
            "{compact} of {}",
            along.blocks.len()
        );
        let sizes = along.blocks[..along.blocks.len() - 1]
            .iter()
            .map(ExactSizeIterator::len);
        assert!(
            sizes.clone().all(|size| (500..=1500).contains(&size)),
            "{:?}",
            sizes.collect::<Vec<_>>()
        );
    }
}

use std::ops::Range;

use glam::Vec3;
use rayon::prelude::*;

use super::Bounds;
use super::points::SpreadOrder;
use super::spacing::local_spacing;
use super::z_order::ZOrder;

/// Points per block, in the mean.
const BLOCK: usize = 16_384;
/// Radius of a point's disc as a share of the spacing around it; 0.71 would close a square grid.
const RADIUS: f32 = 0.75;

/// The points of a cloud, or an even sample of them, in blocks that are compact in space, with the radii of their discs.
#[derive(Default)]
pub(super) struct Arrangement {
    order: Vec<u32>,
    radii: Vec<f32>,
    pub blocks: Vec<Block>,
}

/// Points that lie together.
pub(super) struct Block {
    places: Range<usize>,
    /// Holds all of its points.
    pub bounds: Bounds,
}

impl Block {
    /// How many points it has.
    pub fn len(&self) -> usize {
        self.places.len()
    }
}

impl Arrangement {
    /// All points.
    pub fn of(positions: &[Vec3]) -> Self {
        Self::along(positions, Self::z_order(positions))
    }

    /// The order and the blocks of all points: the first half of the work of [`Self::of`].
    pub fn z_order(positions: &[Vec3]) -> ZOrder {
        ZOrder::new(positions, positions.len(), |place| place, BLOCK)
    }

    /// At most `count` points, spread over all; discs are as large as the sample's spacing demands.
    pub fn of_sample(positions: &[Vec3], count: usize) -> Self {
        let order = SpreadOrder::new(positions.len());
        Self::along(
            positions,
            ZOrder::new(
                positions,
                count.min(positions.len()),
                |place| order.at(place),
                BLOCK,
            ),
        )
    }

    /// The second half: bounds and radii.
    pub fn along(positions: &[Vec3], ZOrder { order, blocks }: ZOrder) -> Self {
        let radii = local_spacing(positions, &order)
            .into_iter()
            .map(|spacing| spacing * RADIUS)
            .collect();
        let bounds = |places: &Range<usize>| {
            let inside = order[places.clone()]
                .iter()
                .map(|&index| positions[index as usize]);
            let (none, all) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
            let (min, max) = inside
                .filter(|x| x.is_finite())
                .fold((none, all), |(min, max), x| (min.min(x), max.max(x)));
            Bounds { min, max }
        };
        let blocks = blocks
            .into_par_iter()
            .map(|places| Block {
                bounds: bounds(&places),
                places,
            })
            .collect();
        Self {
            order,
            radii,
            blocks,
        }
    }

    /// How many points there are.
    pub fn len(&self) -> usize {
        self.order.len()
    }

    /// Index and disc radius (world units) of all points, in no order that matters.
    pub fn discs(&self) -> impl IndexedParallelIterator<Item = (usize, f32)> {
        self.order
            .par_iter()
            .zip(&self.radii)
            .map(|(&index, &radius)| (index as usize, radius))
    }

    /// Index and disc radius of some points of a block, in an order in which every prefix is spread evenly over the block.
    pub fn part_of(&self, block: usize, part: Range<usize>) -> impl Iterator<Item = (usize, f32)> {
        let places = self.blocks[block].places.clone();
        let spread = SpreadOrder::new(places.len());
        part.map(move |nth| {
            let place = places.start + spread.at(nth);
            (self.order[place] as usize, self.radii[place])
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_hold_every_point_once_and_each_prefix_of_a_block_is_spread_over_it() {
        let positions: Vec<Vec3> = (0..250_000)
            .map(|i| Vec3::new((i % 500) as f32, (i / 500) as f32, 0.0))
            .collect();
        let all = Arrangement::of(&positions);
        assert!(all.blocks.len() > 4 && all.len() == positions.len());
        let mut seen = vec![0; positions.len()];
        for (number, block) in all.blocks.iter().enumerate() {
            let Bounds { min, max } = block.bounds;
            for (index, _) in all.part_of(number, 0..block.len()) {
                seen[index] += 1;
                assert!(positions[index].cmpge(min).all() && positions[index].cmple(max).all());
            }
            // Of 100 points about 25 lie in each quarter by the median of a coordinate.
            for along_axis in [Vec3::X, Vec3::Y] {
                let along = |part| {
                    all.part_of(number, part)
                        .map(|(index, _)| positions[index].dot(along_axis))
                };
                let mut sorted: Vec<f32> = along(0..block.len()).collect();
                sorted.sort_by(f32::total_cmp);
                let quarters = [1, 2, 3].map(|quarter| sorted[block.len() * quarter / 4]);
                let mut counts = [0; 4];
                along(0..100).for_each(|x| {
                    counts[quarters.iter().filter(|&&limit| x >= limit).count()] += 1
                });
                assert!(
                    counts.iter().all(|count| (15..=35).contains(count)),
                    "block {number}: {counts:?}"
                );
            }
        }
        assert!(seen.iter().all(|&times| times == 1));
    }

    #[test]
    fn a_sample_is_spread_over_the_cloud_with_discs_that_close_it() {
        let positions: Vec<Vec3> = (0..90_000)
            .map(|i| Vec3::new((i % 300) as f32, (i / 300) as f32, 0.0))
            .collect();
        let sample = Arrangement::of_sample(&positions, 10_000);
        let left = sample
            .discs()
            .filter(|&(index, _)| positions[index].x < 150.0)
            .count();
        assert!(
            sample.len() == 10_000 && (4500..5500).contains(&left),
            "{left}"
        );
        let radius = sample.discs().map(|(_, radius)| radius).sum::<f32>() / 10_000.0;
        assert!(
            (2.0..3.3).contains(&radius),
            "{radius} for every third point along each axis"
        );
    }
}

//! Drawing order of points: blocks along a Z-order curve and disc radii from the local spacing.
//!
//! Both are computed on a background thread.

use std::ops::Range;
use std::sync::mpsc::{Receiver, SendError, Sender, TryRecvError, channel};
use std::sync::{Arc, Weak};

use glam::Vec3;
use rayon::prelude::*;

use super::Bounds;
use super::point_spacing::{RADIUS, Spacing, local_spacing};
use super::spread_order::SpreadOrder;
use ostra_cloud::{LabelledCloud, morton};

/// Average number of points per block.
const BLOCK: usize = 16_384;

/// All points of a cloud, or an even sample of them, in compact blocks with disc radii.
///
/// The order is a Z-order curve rather than an octree. One parallel sort of integers builds it, and
/// neighbours along the curve also give the spacing around each point, which sets its disc radius.
#[derive(Default)]
pub(super) struct PointLod {
    order: Vec<u32>,
    spacing: Vec<Spacing>,
    pub blocks: Vec<LodBlock>,
}

/// The disc that a point is drawn as.
#[derive(Debug, Clone, Copy)]
pub(super) struct Disc {
    /// Index of the point.
    pub index: usize,
    /// Radius in world units.
    pub radius: f32,
    /// Whether the point has no neighbours nearby.
    pub is_lone: bool,
}

impl Disc {
    /// Returns the colour in which the disc is drawn.
    ///
    /// Lone points are a little fainter than others, so that they cast no shade on what is behind
    /// them: eye-dome lighting ignores fainter neighbours.
    pub fn shade(&self, [r, g, b, opacity]: [u8; 4]) -> [u8; 4] {
        if self.is_lone && opacity > 1 {
            [r, g, b, opacity - 1]
        } else {
            [r, g, b, opacity]
        }
    }
}

/// A run of points that are close to each other.
pub(super) struct LodBlock {
    places: Range<usize>,
    /// Bounding box of its finite points.
    pub bounds: Bounds,
}

impl LodBlock {
    /// Returns the number of points.
    pub fn len(&self) -> usize {
        self.places.len()
    }
}

impl PointLod {
    /// Arranges all points.
    pub fn of(positions: &[Vec3]) -> Self {
        Self::along(positions, Self::z_order(positions))
    }

    /// Returns the order and the blocks of all points: the first half of [`Self::of`].
    pub fn z_order(positions: &[Vec3]) -> ZOrder {
        ZOrder::new(positions, positions.len(), |place| place, BLOCK)
    }

    /// Arranges at most `count` points, spread over all.
    ///
    /// Disc radii follow the spacing of the sample.
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

    /// Computes bounds and radii for an order: the second half of [`Self::of`].
    pub fn along(positions: &[Vec3], ZOrder { order, blocks }: ZOrder) -> Self {
        let spacing = local_spacing(positions, &order);
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
            .map(|places| LodBlock {
                bounds: bounds(&places),
                places,
            })
            .collect();
        Self {
            order,
            spacing,
            blocks,
        }
    }

    /// Returns the number of points.
    pub fn len(&self) -> usize {
        self.order.len()
    }

    /// Returns the discs of all points, in unspecified order.
    pub fn discs(&self) -> impl IndexedParallelIterator<Item = Disc> {
        (0..self.order.len())
            .into_par_iter()
            .map(|place| self.disc(place))
    }

    fn disc(&self, place: usize) -> Disc {
        let (index, radius) = (
            self.order[place] as usize,
            self.spacing[place].length * RADIUS,
        );
        let is_lone = self.spacing[place].is_lone;
        Disc {
            index,
            radius,
            is_lone,
        }
    }

    /// Returns the discs of some points of a block.
    ///
    /// The points are in an order in which every prefix is spread evenly over the block.
    pub fn part_of(&self, block: usize, part: Range<usize>) -> impl Iterator<Item = Disc> {
        let places = self.blocks[block].places.clone();
        let spread = SpreadOrder::new(places.len());
        part.map(move |nth| self.disc(places.start + spread.at(nth)))
    }
}

/// Number of points from which the position and size of the grid are estimated.
const SAMPLED: usize = 100_000;

/// Points along a Z-order curve, cut into blocks.
pub(super) struct ZOrder {
    /// Point indices along the curve.
    pub order: Vec<u32>,
    /// Consecutive ranges of [`Self::order`].
    pub blocks: Vec<Range<usize>>,
}

impl ZOrder {
    /// Sorts the points `index(0)` to `index(count - 1)` along the curve and cuts it into blocks.
    ///
    /// Blocks have about `size` points, between half and one and a half times as many. The last
    /// block may have fewer. A block ends where the curve jumps farthest, so that blocks are
    /// compact.
    ///
    /// The cell code and the point index share 64 bits. Only integers are sorted, and the order is
    /// the same for any number of threads.
    pub fn new(
        positions: &[Vec3],
        count: usize,
        index: impl Fn(usize) -> usize + Sync,
        size: usize,
    ) -> Self {
        let index_bits = u64::BITS - (positions.len() as u64).leading_zeros();
        let grid = LodGrid::over(positions, ((u64::BITS - index_bits) / 3).min(21));
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

/// A regular grid of cubes around the points.
struct LodGrid {
    min: Vec3,
    per_unit: f32,
    last: f32,
}

impl LodGrid {
    /// Creates a grid twice as large as the extent of all but a few points.
    ///
    /// Outliers beyond it are assigned to its outermost cells.
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

/// Number of points that are shown until all points are arranged.
const SAMPLE: usize = 65_536;

/// A cloud with its arrangement.
pub(super) type Arranged = (Arc<LabelledCloud>, Arc<PointLod>);

/// A cloud that is being arranged in the background, an even sample of it first.
///
/// If this is dropped, the work ends after its current step.
pub(super) struct LodBuild {
    arrived: Receiver<Arc<PointLod>>,
    _wanted: Arc<()>,
}

/// State of an [`Arranging`].
pub(super) enum Arrival {
    /// An arrangement of a sample or of all points.
    Some(Arc<PointLod>),
    /// No arrangement is available yet.
    NotYet,
    /// The work has ended.
    Over,
}

impl LodBuild {
    /// Starts arranging; `before` is reused if its points have the same positions.
    pub fn begin(cloud: Arc<LabelledCloud>, before: Option<Arranged>) -> Self {
        let (sender, arrived) = channel();
        let wanted = Arc::new(());
        let is_wanted = Arc::downgrade(&wanted);
        // Sending fails only if the result is no longer wanted.
        outside_job_pool(move || arrange(&cloud, before, &sender, &is_wanted).unwrap_or_default());
        Self {
            arrived,
            _wanted: wanted,
        }
    }

    /// Returns an arrangement that was completed since the last call.
    pub fn next(&self) -> Arrival {
        match self.arrived.try_recv() {
            Ok(point_lod) => Arrival::Some(point_lod),
            Err(TryRecvError::Empty) => Arrival::NotYet,
            Err(TryRecvError::Disconnected) => Arrival::Over,
        }
    }
}

/// Runs work on a thread pool of its own, with half as many threads as the machine has.
///
/// In the global pool it would wait for the jobs of the program.
pub(super) fn outside_job_pool(work: impl FnOnce() + Send + 'static) {
    let threads = std::thread::available_parallelism().map_or(1, |all| all.get().div_ceil(2));
    match rayon::ThreadPoolBuilder::new().num_threads(threads).build() {
        Ok(pool) => pool.spawn(work),
        Err(_) => rayon::spawn(work),
    }
}

fn arrange(
    cloud: &LabelledCloud,
    before: Option<Arranged>,
    sender: &Sender<Arc<PointLod>>,
    wanted: &Weak<()>,
) -> Result<(), SendError<Arc<PointLod>>> {
    if let Some((_, point_lod)) = before.filter(|(other, _)| other.positions == cloud.positions) {
        return sender.send(point_lod);
    }
    if cloud.len() > SAMPLE {
        sender.send(Arc::new(PointLod::of_sample(&cloud.positions, SAMPLE)))?;
    }
    let order = PointLod::z_order(&cloud.positions);
    if wanted.strong_count() == 0 {
        return Ok(());
    }
    sender.send(Arc::new(PointLod::along(&cloud.positions, order)))
}

#[cfg(test)]
mod tests;

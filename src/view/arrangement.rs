//! The order in which points are drawn: blocks along a z-order curve, disc radii by the spacing around each point,
//! and the thread that computes both.

use std::ops::Range;
use std::sync::mpsc::{Receiver, SendError, Sender, TryRecvError, channel};
use std::sync::{Arc, Weak};

use glam::Vec3;
use rayon::prelude::*;

use super::Bounds;
use ostra_cloud::{LabelledCloud, morton};

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

/// Points before and after in the order among which neighbours are looked for.
const REACH: usize = 16;
/// The neighbour whose distance counts: on a surface the fourth lies about as far away as a square that a point has to
/// itself is wide, be the points strewn or on a grid.
const NEIGHBOUR: usize = 4;
/// On a surface the fourth neighbour is hardly farther away than this many times the second (1.46 where points are
/// strewn); along a stem of single points it is, whose discs would stand out.
const MOST_OF_SECOND: f32 = 1.5;
/// Points in a row that are held against each other.
const RUN: usize = 16;
/// A point is no farther from its neighbours than this many times what is usual in most of its run and the two beside it …
const MOST_OF_RUNS: f32 = 1.5;
/// … and this many times what is usual in the cloud, so that strays get no giant discs.
const MOST_OF_CLOUD: f32 = 6.0;
/// Points worked on by one thread at a time.
const PIECE: usize = 256 * RUN;

/// How far apart points are around each point of `order`, along which neighbours in space are near each other, in world
/// units; 0 where a cloud has too few points to tell.
fn local_spacing(positions: &[Vec3], order: &[u32]) -> Vec<f32> {
    let mut spacing = vec![0.0; order.len()];
    spacing
        .par_chunks_mut(PIECE)
        .enumerate()
        .for_each(|(piece, own)| to_neighbours(positions, order, piece * PIECE, own));
    let usual_of_runs: Vec<f32> = spacing
        .par_chunks(RUN)
        .map(|run| median(run.to_vec()))
        .collect();
    let sample = SpreadOrder::new(usual_of_runs.len());
    let usual = median(
        (0..usual_of_runs.len().min(100_000))
            .map(|place| usual_of_runs[sample.at(place)])
            .collect(),
    );
    let most = if usual.is_finite() {
        usual * MOST_OF_CLOUD
    } else {
        0.0
    };
    spacing
        .par_chunks_mut(RUN)
        .enumerate()
        .for_each(|(run, own)| {
            let around = &usual_of_runs[run.saturating_sub(1)..(run + 2).min(usual_of_runs.len())];
            let most = (median(around.to_vec()) * MOST_OF_RUNS).min(most);
            own.iter_mut().for_each(|one| *one = one.min(most));
        });
    spacing
}

/// Fills in how far each point from place `first` on lies from its neighbours (infinity where it has too few); another point
/// at the very same place is none.
fn to_neighbours(positions: &[Vec3], order: &[u32], first: usize, own: &mut [f32]) {
    let begin = first.saturating_sub(REACH);
    let end = (first + own.len() + REACH).min(order.len());
    let near: Vec<Vec3> = order[begin..end]
        .iter()
        .map(|&index| positions[index as usize])
        .collect();
    for (offset, own) in own.iter_mut().enumerate() {
        let at = first + offset - begin;
        let mut nearest = [f32::INFINITY; NEIGHBOUR];
        for other in &near[at.saturating_sub(REACH)..(at + REACH + 1).min(near.len())] {
            let mut squared = other.distance_squared(near[at]);
            if squared > 0.0 && squared < nearest[NEIGHBOUR - 1] {
                for kept in &mut nearest {
                    (*kept, squared) = (kept.min(squared), kept.max(squared));
                }
            }
        }
        *own = nearest[NEIGHBOUR - 1]
            .sqrt()
            .min(nearest[1].sqrt() * MOST_OF_SECOND);
    }
}

/// 0 for none.
fn median(mut values: Vec<f32>) -> f32 {
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f32::total_cmp).1
}

/// Points that are shown until all are arranged.
const SAMPLE: usize = 65_536;

/// A cloud with its arrangement.
pub(super) type Arranged = (Arc<LabelledCloud>, Arc<Arrangement>);

/// A cloud that is being arranged in the background, an even sample of it first. When this is dropped, the work ends at
/// its next step.
pub(super) struct Arranging {
    arrived: Receiver<Arc<Arrangement>>,
    _wanted: Arc<()>,
}

/// What an [`Arranging`] has to give.
pub(super) enum Arrival {
    /// A sample or all.
    Some(Arc<Arrangement>),
    /// Nothing now.
    NotYet,
    /// Nothing any more.
    Over,
}

impl Arranging {
    /// Begins; the arrangement `before` serves again if its points lie in the same places.
    pub fn begin(cloud: Arc<LabelledCloud>, before: Option<Arranged>) -> Self {
        let (sender, arrived) = channel();
        let wanted = Arc::new(());
        let is_wanted = Arc::downgrade(&wanted);
        // An error says that nobody waits any more.
        beside_jobs(move || arrange(&cloud, before, &sender, &is_wanted).unwrap_or_default());
        Self {
            arrived,
            _wanted: wanted,
        }
    }

    /// What has come since.
    pub fn next(&self) -> Arrival {
        match self.arrived.try_recv() {
            Ok(arrangement) => Arrival::Some(arrangement),
            Err(TryRecvError::Empty) => Arrival::NotYet,
            Err(TryRecvError::Disconnected) => Arrival::Over,
        }
    }
}

/// Works on threads of its own, half as many as the machine's: in the pool of the program's jobs it would stand behind them.
pub(super) fn beside_jobs(work: impl FnOnce() + Send + 'static) {
    let threads = std::thread::available_parallelism().map_or(1, |all| all.get().div_ceil(2));
    match rayon::ThreadPoolBuilder::new().num_threads(threads).build() {
        Ok(pool) => pool.spawn(work),
        Err(_) => rayon::spawn(work),
    }
}

fn arrange(
    cloud: &LabelledCloud,
    before: Option<Arranged>,
    sender: &Sender<Arc<Arrangement>>,
    wanted: &Weak<()>,
) -> Result<(), SendError<Arc<Arrangement>>> {
    if let Some((_, arrangement)) = before.filter(|(other, _)| other.positions == cloud.positions) {
        return sender.send(arrangement);
    }
    if cloud.len() > SAMPLE {
        sender.send(Arc::new(Arrangement::of_sample(&cloud.positions, SAMPLE)))?;
    }
    let order = Arrangement::z_order(&cloud.positions);
    if wanted.strong_count() == 0 {
        return Ok(());
    }
    sender.send(Arc::new(Arrangement::along(&cloud.positions, order)))
}

/// An order of `0..count` in which every prefix is spread evenly over the whole: multiples of the golden section.
#[derive(Debug, Clone, Copy)]
pub(super) struct SpreadOrder {
    count: u64,
    stride: u64,
}

impl SpreadOrder {
    pub(super) fn new(count: usize) -> Self {
        let count = count as u64;
        let mut stride = ((count as f64 * 0.618_033_988_75) as u64).max(1);
        while gcd(stride, count) > 1 {
            stride += 1;
        }
        Self { count, stride }
    }

    /// The element at `place`.
    pub(super) fn at(&self, place: usize) -> usize {
        (place as u64 * self.stride % self.count.max(1)) as usize
    }
}

fn gcd(a: u64, b: u64) -> u64 {
    if b == 0 { a } else { gcd(b, a % b) }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use rand::{RngExt, SeedableRng};

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
                    counts[quarters.iter().filter(|&&limit| x >= limit).count()] += 1;
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

    /// By index of the point.
    fn spacing(positions: &[Vec3]) -> Vec<f32> {
        let order = ZOrder::new(positions, positions.len(), |place| place, 1000).order;
        let along = local_spacing(positions, &order);
        let mut by_index = vec![0.0; positions.len()];
        order
            .iter()
            .zip(along)
            .for_each(|(&index, spacing)| by_index[index as usize] = spacing);
        by_index
    }

    /// Points strewn over a square, `side` × `side` of them in the mean.
    fn strewn(side: usize, width: f32) -> Vec<Vec3> {
        let mut random = rand_pcg::Pcg64::seed_from_u64(7);
        (0..side * side)
            .map(|_| Vec3::new(random.random::<f32>(), random.random::<f32>(), 0.0) * width)
            .collect()
    }

    #[test]
    fn the_spacing_of_a_plane_is_its_step_on_a_grid_and_strewn() {
        let grid: Vec<Vec3> = (0..40_000)
            .map(|i| Vec3::new((i % 200) as f32, (i / 200) as f32, 0.0) * 0.01)
            .collect();
        for (what, positions) in [("grid", grid), ("strewn", strewn(200, 2.0))] {
            let spacing = spacing(&positions);
            let usual = median(spacing.clone());
            assert!((0.0095..0.0145).contains(&usual), "{what}: {usual}");
            let near = spacing
                .iter()
                .filter(|one| (0.006..0.02).contains(*one))
                .count();
            assert!(near * 100 >= spacing.len() * 90, "{what}: {near}");
        }
    }

    #[test]
    fn each_half_of_a_cloud_has_its_own_spacing_and_strays_none_of_their_own() {
        let mut positions = strewn(150, 1.0);
        let dense = positions.len();
        positions.extend(strewn(40, 1.0).into_iter().map(|x| x - Vec3::X));
        let sparse = positions.len();
        positions.extend([Vec3::splat(30.0), Vec3::new(-20.0, 9.0, 1.0), Vec3::NAN]);
        let spacing = spacing(&positions);
        let share = |range: std::ops::Range<usize>, step: f32| {
            let near = spacing[range.clone()]
                .iter()
                .filter(|one| (0.5 * step..2.0 * step).contains(*one))
                .count();
            near * 100 / range.len()
        };
        assert!(
            share(0..dense, 1.0 / 150.0) >= 90,
            "{}",
            share(0..dense, 1.0 / 150.0)
        );
        assert!(
            share(dense..sparse, 1.0 / 40.0) >= 85,
            "{}",
            share(dense..sparse, 1.0 / 40.0)
        );
        assert!(
            spacing[sparse..].iter().all(|&one| one < 0.06),
            "{:?}",
            &spacing[sparse..]
        );
    }

    #[test]
    fn too_few_points_have_no_spacing_and_doubles_do_not_count() {
        assert_eq!(spacing(&[Vec3::ONE, Vec3::X]), [0.0; 2]);
        let square = strewn(60, 1.0);
        let twice: Vec<Vec3> = square.iter().flat_map(|&x| [x; 3]).collect();
        assert!(median(spacing(&twice)) > 1.0 / 60.0 * 0.6);
    }

    fn all_that_comes(arranging: &Arranging) -> Vec<Arc<Arrangement>> {
        let mut came = Vec::new();
        loop {
            match arranging.next() {
                Arrival::Some(arrangement) => came.push(arrangement),
                Arrival::NotYet => std::thread::yield_now(),
                Arrival::Over => return came,
            }
        }
    }

    fn row(points: usize) -> Arc<LabelledCloud> {
        Arc::new(LabelledCloud::from_positions(
            (0..points).map(|i| Vec3::X * i as f32).collect(),
        ))
    }

    #[test]
    fn a_sample_comes_first_and_the_same_places_are_arranged_once() {
        let large = row(SAMPLE + 1000);
        let came = all_that_comes(&Arranging::begin(Arc::clone(&large), None));
        assert_eq!(
            came.iter().map(|one| one.len()).collect::<Vec<_>>(),
            [SAMPLE, SAMPLE + 1000]
        );
        let recolored = Arc::new(LabelledCloud {
            colors: vec![[1, 2, 3]; large.len()],
            ..(*large).clone()
        });
        let again = all_that_comes(&Arranging::begin(
            recolored,
            Some((large, Arc::clone(&came[1]))),
        ));
        assert!(again.len() == 1 && Arc::ptr_eq(&again[0], &came[1]));
        let small = all_that_comes(&Arranging::begin(
            row(100),
            Some((row(101), Arc::clone(&came[1]))),
        ));
        assert_eq!(small.iter().map(|one| one.len()).collect::<Vec<_>>(), [100]);
    }

    #[test]
    fn dropped_work_lets_its_cloud_go() {
        let cloud = row(200_000);
        drop(Arranging::begin(Arc::clone(&cloud), None));
        let ended = (0..50_000_000).any(|_| {
            std::thread::yield_now();
            Arc::strong_count(&cloud) == 1
        });
        assert!(ended, "nobody else holds the cloud in the end");
    }

    #[test]
    fn spread_order_visits_every_point_once() {
        for count in [1, 2, 7, 100, 4096, 99_991] {
            let order = SpreadOrder::new(count);
            let mut seen = vec![false; count];
            for place in 0..count {
                assert!(
                    !std::mem::replace(&mut seen[order.at(place)], true),
                    "{count}"
                );
            }
        }
    }
}

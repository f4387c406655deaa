//! Spacing of points in a cloud, found along the Z-order curve, and which points are lone.

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::{IVec3, Vec3};
use rayon::prelude::*;
use rustc_hash::FxHashMap;

use super::spread_order::SpreadOrder;
use ostra_core::statistics::upper_median;

/// Disc radius as a share of the local spacing; 0.71 would close a square grid.
pub(super) const RADIUS: f32 = 0.75;
/// Number of points before and after a point in the order that are searched for neighbours.
const REACH: usize = 16;
/// Rank of the neighbour whose distance is the spacing.
///
/// On a surface, the distance to the fourth neighbour is about the side of the square that each
/// point has to itself. That holds for random points and for a grid.
const NEIGHBOUR: usize = 4;
/// Maximum spacing as a multiple of the distance to the second neighbour.
///
/// On a surface the fourth neighbour is hardly farther than that (1.46 times for random points).
/// Along a stem that is one point wide it is farther, and the discs would protrude from the stem.
const MOST_OF_SECOND: f32 = 1.5;
/// Number of consecutive points whose median spacing is compared.
const RUN: usize = 16;
/// Maximum spacing as a multiple of the median over three runs (of the median of each run).
const MOST_OF_RUNS: f32 = 1.5;
/// Spacing as multiples of the median over the cloud and over three runs.
///
/// A point with a larger spacing is lone.
const MOST_OF_LONE: [f32; 2] = [4.0, 3.0];
/// Spacing as a multiple of the median over the cloud, from which all points of a run are lone.
const LONE_RUN: f32 = 8.0;
/// Maximum spacing as a multiple of the median over the cloud.
const MOST_OF_CLOUD: f32 = 6.0;
/// Spacing that a lone point is drawn with, as a multiple of the median over the cloud.
///
/// Its disc is twice as wide as the spacing. Larger discs of outliers would hide what is behind
/// them.
const OF_LONE: f32 = 1.0 / RADIUS;
/// Number of points per parallel task.
const PIECE: usize = 256 * RUN;

/// Spacing around a point.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Spacing {
    /// Distance to neighbours in world units, limited so that discs of outliers stay small.
    pub length: f32,
    /// Whether the point has no neighbours nearby.
    pub is_lone: bool,
}

/// Estimates the spacing between points around each point of `order`.
///
/// Neighbours in space must be near each other in `order`. The spacing is 0 where a cloud has too
/// few points.
pub(super) fn local_spacing(positions: &[Vec3], order: &[u32]) -> Vec<Spacing> {
    let mut spacing = vec![0.0; order.len()];
    spacing
        .par_chunks_mut(PIECE)
        .enumerate()
        .for_each(|(piece, own)| to_neighbours(positions, order, piece * PIECE, own));
    let usual_of_runs: Vec<f32> = spacing
        .par_chunks(RUN)
        .map(|run| median_spacing(run.to_vec()))
        .collect();
    let sample = SpreadOrder::new(usual_of_runs.len());
    let usual = median_spacing(
        (0..usual_of_runs.len().min(100_000))
            .map(|place| usual_of_runs[sample.at(place)])
            .collect(),
    );
    let usual = if usual.is_finite() { usual } else { 0.0 };
    let around = |run: usize| {
        let runs = run.saturating_sub(1)..(run + 2).min(usual_of_runs.len());
        median_spacing(usual_of_runs[runs].to_vec())
    };
    let around: Vec<f32> = (0..usual_of_runs.len())
        .into_par_iter()
        .map(around)
        .collect();
    let seems_lone = |place: usize| {
        let (length, local) = (spacing[place], around[place / RUN]);
        let is_far = length > usual * MOST_OF_LONE[0] && length > local * MOST_OF_LONE[1];
        is_far || length.min(local * MOST_OF_RUNS) > usual * LONE_RUN
    };
    let lone: BTreeSet<usize> = without_company(
        positions,
        order,
        (0..order.len())
            .into_par_iter()
            .filter(|&place| seems_lone(place))
            .collect(),
        usual * MOST_OF_LONE[0],
    );
    let limited = |(place, &length): (usize, &f32)| {
        let most = around[place / RUN] * MOST_OF_RUNS;
        let is_lone = lone.contains(&place);
        Spacing {
            length: length.min(if is_lone {
                usual * OF_LONE
            } else {
                most.min(usual * MOST_OF_CLOUD)
            }),
            is_lone,
        }
    };
    spacing.par_iter().enumerate().map(limited).collect()
}

/// Returns those of `places` with fewer than [`NEIGHBOUR`] points within `radius`.
///
/// The order along the curve jumps: a point in the middle of a surface can have its neighbours far
/// away in the order. This looks at all points of `order`, in cubes around the few in question.
fn without_company(
    positions: &[Vec3],
    order: &[u32],
    places: Vec<usize>,
    radius: f32,
) -> BTreeSet<usize> {
    if radius <= 0.0 {
        return places.into_iter().collect();
    }
    let position = |place: usize| positions[order[place] as usize];
    let cube = |x: Vec3| (x / radius).floor().as_ivec3();
    let mut around: FxHashMap<IVec3, Vec<usize>> = FxHashMap::default();
    for (number, &place) in places.iter().enumerate() {
        let own = cube(position(place));
        for step in 0..27 {
            let offset = IVec3::new(step % 3, step / 3 % 3, step / 9) - IVec3::ONE;
            around
                .entry(own.wrapping_add(offset))
                .or_default()
                .push(number);
        }
    }
    let counts: Vec<AtomicUsize> = places.iter().map(|_| AtomicUsize::new(0)).collect();
    if !around.is_empty() {
        order.par_iter().for_each(|&index| {
            let other = positions[index as usize];
            for &number in around.get(&cube(other)).into_iter().flatten() {
                let squared = other.distance_squared(position(places[number]));
                if squared > 0.0 && squared <= radius * radius {
                    counts[number].fetch_add(1, Ordering::Relaxed);
                }
            }
        });
    }
    places
        .into_iter()
        .zip(counts)
        .filter(|(_, count)| count.load(Ordering::Relaxed) < NEIGHBOUR)
        .map(|(place, _)| place)
        .collect()
}

/// Writes the distance to the neighbours of each point from position `first` of `order` on.
///
/// The distance is infinite where there are too few neighbours. Points at the same position are not
/// neighbours.
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

/// Returns the median, or 0 without points.
pub(super) fn median_spacing(mut spacing: Vec<f32>) -> f32 {
    upper_median(&mut spacing).unwrap_or(0.0)
}

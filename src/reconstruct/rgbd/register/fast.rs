use glam::DVec3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::align::align;
use super::pairs::Pairs;
use ostra_geometry::Pose;

/// How alike the edges of a tuple must be in both clouds.
const TUPLE_RATIO: f64 = 0.95;
/// Tuples tried for each pair; ten times the paper's, so that clouds which share a quarter still yield some.
const TRIALS: usize = 1000;
/// Tuples used at most.
const MAX_TUPLES: usize = 1000;
const ITERATIONS: usize = 64;
/// What the width of the kernel is divided by, every `STEPS` iterations.
const DIVISION: f64 = 1.4;
const STEPS: usize = 4;

/// Fast Global Registration (Q.-Y. Zhou, J. Park, V. Koltun, *Fast Global Registration*, ECCV 2016): the pose of least
/// Geman–McClure cost over the matched points of tuples of three whose edges have the same lengths in both clouds; the
/// kernel, as wide as the clouds at first, narrows in steps down to `distance`. The pose of each step is solved in
/// closed form, so turns of any size are found.
pub fn fast(pairs: &Pairs, distance: f64, seed: u64) -> Option<Pose> {
    let chosen = tuples(pairs, seed);
    let diameter = [0, 1]
        .map(|end| 2.0 * reach(&chosen, end))
        .into_iter()
        .fold(0.0, f64::max);
    let mut width = diameter * diameter;
    let mut pose = align(chosen.iter().map(|&[source, target]| (source, target, 1.0)))?;
    for iteration in 1..=ITERATIONS {
        let weighted = chosen.iter().map(|&[source, target]| {
            let share = width / (width + pose.transform(source).distance_squared(target));
            (source, target, share * share)
        });
        pose = align(weighted)?;
        if iteration % STEPS == 0 {
            width = (width / DIVISION).max(distance * distance);
        }
    }
    Some(pose)
}

/// Matched points of random tuples that fit together.
fn tuples(pairs: &Pairs, seed: u64) -> Vec<[DVec3; 2]> {
    let (count, mut random) = (pairs.points.len(), Pcg64Mcg::seed_from_u64(seed));
    let mut chosen = Vec::new();
    if count < 3 {
        return chosen;
    }
    for _ in 0..TRIALS * count {
        let [a, b, c] = std::array::from_fn(|_| random.random_range(0..count));
        if [[a, b], [b, c], [c, a]]
            .iter()
            .all(|&[one, other]| pairs.fit_together(one, other, TUPLE_RATIO))
        {
            chosen.extend([a, b, c].map(|pair| pairs.points[pair]));
            if chosen.len() >= 3 * MAX_TUPLES {
                break;
            }
        }
    }
    chosen
}

/// The largest distance of a point to the middle of all.
fn reach(points: &[[DVec3; 2]], end: usize) -> f64 {
    let middle = points.iter().map(|pair| pair[end]).sum::<DVec3>() / points.len().max(1) as f64;
    points
        .iter()
        .map(|pair| pair[end].distance(middle))
        .fold(0.0, f64::max)
}

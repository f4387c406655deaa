use glam::DVec3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::position::{Sighting, largest_angle, nearest_to_rays, triangulate};

/// When sightings agree.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TriangulationOptions {
    /// Largest reprojection error of an inlier in pixels.
    pub max_error_px: f64,
    /// Least angle between the two rays that are farthest apart, in radians.
    pub min_angle: f64,
}

impl Default for TriangulationOptions {
    fn default() -> Self {
        Self {
            max_error_px: 4.0,
            min_angle: 1.5f64.to_radians(),
        }
    }
}

/// A point and who sees it.
#[derive(Debug, Clone, PartialEq)]
pub struct Triangulated {
    /// In world space.
    pub position: DVec3,
    /// Indices of the sightings that agree, ascending.
    pub inliers: Vec<u32>,
}

/// With more views than this, pairs are drawn instead of all tried; as many as this many views have.
const ALL_PAIRS: usize = 15;
const MOST_PAIRS: usize = ALL_PAIRS * (ALL_PAIRS - 1) / 2;
/// Seed of the draw: the same track is always the same point.
const SEED: u64 = 0;

/// The point on which most sightings of a track agree, which may hold wrong ones: pairs of rays are met, those with the
/// widest angle first, and the point that most sightings see within `max_error_px` is refined over them. `None` where
/// fewer than two agree, or none of their rays are `min_angle` apart.
#[must_use]
pub fn triangulate_robust(
    views: &[Sighting],
    options: &TriangulationOptions,
) -> Option<Triangulated> {
    let limit = options.max_error_px * options.max_error_px;
    let mut best: Option<(Vec<u32>, f64)> = None;
    for [i, k] in pairs_by_angle(views, options.min_angle) {
        let Some(position) = nearest_to_rays(&[views[i], views[k]]) else {
            continue;
        };
        let errors = || views.iter().map(|view| view.error_squared(position));
        let inliers: Vec<u32> = (0..)
            .zip(errors())
            .filter(|&(_, error)| error <= limit)
            .map(|(at, _)| at)
            .collect();
        let cost = errors().map(|error| error.min(limit)).sum();
        if best
            .as_ref()
            .is_none_or(|(most, least)| (inliers.len(), *least) > (most.len(), cost))
        {
            let all = inliers.len() == views.len();
            best = Some((inliers, cost));
            if all {
                break;
            }
        }
    }
    agreed(views, &best?.0, options)
}

/// The point refined over its inliers, if these hold.
fn agreed(
    views: &[Sighting],
    inliers: &[u32],
    options: &TriangulationOptions,
) -> Option<Triangulated> {
    let limit = options.max_error_px * options.max_error_px;
    let chosen: Vec<Sighting> = inliers.iter().map(|&at| views[at as usize]).collect();
    let position = triangulate(&chosen)?;
    let hold: Vec<u32> = (0..)
        .zip(views)
        .filter(|(_, view)| view.error_squared(position) <= limit)
        .map(|(at, _)| at)
        .collect();
    let centres: Vec<DVec3> = hold
        .iter()
        .map(|&at| views[at as usize].camera_from_world.centre())
        .collect();
    let wide = hold.len() >= 2 && largest_angle(position, &centres) >= options.min_angle;
    wide.then_some(Triangulated {
        position,
        inliers: hold,
    })
}

/// Pairs of views whose rays are at least half of `min_angle` apart, the widest first.
fn pairs_by_angle(views: &[Sighting], min_angle: f64) -> Vec<[usize; 2]> {
    let directions: Vec<DVec3> = views.iter().map(Sighting::direction).collect();
    let widest = (0.5 * min_angle).cos();
    let mut pairs: Vec<([usize; 2], f64)> = Vec::new();
    let mut consider = |i: usize, k: usize| {
        let cosine = directions[i].dot(directions[k]);
        if cosine <= widest {
            pairs.push(([i, k], cosine));
        }
    };
    if views.len() <= ALL_PAIRS {
        (0..views.len()).for_each(|k| (0..k).for_each(|i| consider(i, k)));
    } else {
        let mut random = Pcg64Mcg::seed_from_u64(SEED);
        for _ in 0..MOST_PAIRS {
            let (i, step) = (
                random.random_range(0..views.len()),
                random.random_range(1..views.len()),
            );
            consider(i, (i + step) % views.len());
        }
    }
    // A right angle meets best; beyond it rays run towards each other again.
    pairs.sort_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
    pairs.into_iter().map(|(pair, _)| pair).collect()
}

//! Triangulation of points from several views.

use glam::{DMat3, DVec2, DVec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::solvers::{Linearised, Problem, minimise};
use crate::{Camera, Pose};

/// Observation of a point by one camera.
#[derive(Debug, Clone, Copy)]
pub struct RayObservation<'a> {
    /// Intrinsics of the camera.
    pub camera: &'a Camera,
    /// Pose of the camera.
    pub camera_from_world: &'a Pose,
    /// Position, pixels.
    pub at_px: DVec2,
    /// Position on the plane z = 1, without lens distortion.
    pub at_plane: DVec2,
}

impl RayObservation<'_> {
    /// Returns the direction of the ray in world space, length 1.
    pub(super) fn direction(&self) -> DVec3 {
        self.camera_from_world.rotation.conjugate() * self.at_plane.extend(1.0).normalize()
    }

    /// Returns the squared reprojection error in pixels, measured on the plane z = 1.
    ///
    /// Infinite behind the camera.
    pub(super) fn error_squared(&self, position: DVec3) -> f64 {
        let x = self.camera_from_world.transform(position);
        if x.z > 0.0 {
            self.miss(x).length_squared()
        } else {
            f64::INFINITY
        }
    }

    fn miss(&self, x_in_camera: DVec3) -> DVec2 {
        (x_in_camera.truncate() / x_in_camera.z - self.at_plane) * self.camera.focal_px
    }
}

/// Number of refinement steps.
const STEPS: usize = 5;
/// Smallest eigenvalue of the rays' equations, per view, below which the rays are parallel.
///
/// This is the square of about 1e-5 radians.
const PARALLEL: f64 = 1e-10;

/// Triangulates the point with the least squared reprojection error.
///
/// The start is the point nearest to all rays (R. Hartley, P. Sturm, *Triangulation*, CVIU 1997,
/// with Levenberg–Marquardt instead of a polynomial). Errors are measured on the plane z = 1 in
/// units of the focal length. Returns `None` for fewer than two views, for parallel rays, and if
/// the point lies behind a camera.
#[must_use]
pub fn triangulate(views: &[RayObservation]) -> Option<DVec3> {
    let start = nearest_to_rays(views)?;
    let end = minimise(
        Nearness {
            views,
            position: start,
        },
        STEPS,
    )
    .position;
    in_front(views, end).then_some(end)
}

fn in_front(views: &[RayObservation], position: DVec3) -> bool {
    position.is_finite()
        && views
            .iter()
            .all(|view| view.camera_from_world.transform(position).z > 0.0)
}

/// Returns the point with the least squared distance from all rays.
pub(super) fn nearest_to_rays(views: &[RayObservation]) -> Option<DVec3> {
    let (mut across, mut towards) = (DMat3::ZERO, DVec3::ZERO);
    for view in views {
        let d = view.direction();
        let off = DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z);
        across += off;
        towards += off * view.camera_from_world.centre();
    }
    // Two eigenvalues are close to the number of views; the third is small for nearly parallel
    // rays.
    let count = views.len() as f64;
    let parallel = across.determinant() <= PARALLEL * count * count * count;
    let position = across.inverse() * towards;
    (views.len() >= 2 && !parallel && in_front(views, position)).then_some(position)
}

struct Nearness<'a> {
    views: &'a [RayObservation<'a>],
    position: DVec3,
}

impl Problem<3> for Nearness<'_> {
    fn linearise(&self) -> Linearised<3> {
        let mut sum = Linearised::ZERO;
        for view in self.views {
            let x = view.camera_from_world.transform(self.position);
            if x.z.is_nan() || x.z <= 0.0 {
                sum.cost = f64::INFINITY;
                return sum;
            }
            let miss = view.miss(x);
            sum.cost += miss.length_squared();
            let to_world = view.camera_from_world.rotation.conjugate();
            let f = view.camera.focal_px / x.z;
            let rows = [
                DVec3::new(f.x, 0.0, -f.x * x.x / x.z),
                DVec3::new(0.0, f.y, -f.y * x.y / x.z),
            ];
            for (residual, row) in miss.to_array().into_iter().zip(rows) {
                sum.add(residual, &(to_world * row).to_array(), 1.0);
            }
        }
        sum
    }

    fn moved(&self, step: &[f64; 3]) -> Self {
        Self {
            position: self.position + DVec3::from(*step),
            ..*self
        }
    }
}

/// Returns the largest angle between two camera centres as seen from a point, radians.
///
/// Returns 0 for fewer than two centres.
#[must_use]
pub fn largest_angle(position: DVec3, centres: &[DVec3]) -> f64 {
    let mut least: f64 = 1.0;
    let directions: Vec<DVec3> = centres
        .iter()
        .map(|&centre| (centre - position).normalize_or_zero())
        .collect();
    for (at, a) in directions.iter().enumerate() {
        least = directions[..at]
            .iter()
            .fold(least, |least, b| least.min(a.dot(*b)));
    }
    least.clamp(-1.0, 1.0).acos()
}

/// Options of [`triangulate_robust`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TriangulationOptions {
    /// Maximum reprojection error of an inlier, pixels.
    pub max_error_px: f64,
    /// Minimum angle between the two rays that are farthest apart, radians.
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

/// A triangulated point and its inliers.
#[derive(Debug, Clone, PartialEq)]
pub struct Triangulated {
    /// Position in world space.
    pub position: DVec3,
    /// Indices of the observations that agree, ascending.
    pub inliers: Vec<u32>,
}

/// Number of views above which pairs are sampled.
///
/// The number of samples is the number of pairs of this many views.
const ALL_PAIRS: usize = 15;
const MOST_PAIRS: usize = ALL_PAIRS * (ALL_PAIRS - 1) / 2;
/// Seed of the samples: the same track always gives the same point.
const SEED: u64 = 0;

/// Triangulates a track that may contain wrong observations.
///
/// Pairs of rays are intersected, those with the widest angle first. The point with the most
/// observations within `max_error_px` is refined over them. Returns `None` if fewer than two agree,
/// or if none of their rays are `min_angle` apart.
#[must_use]
pub fn triangulate_robust(
    views: &[RayObservation],
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

/// Refines a point over its inliers; returns `None` if they no longer agree.
fn agreed(
    views: &[RayObservation],
    inliers: &[u32],
    options: &TriangulationOptions,
) -> Option<Triangulated> {
    let limit = options.max_error_px * options.max_error_px;
    let chosen: Vec<RayObservation> = inliers.iter().map(|&at| views[at as usize]).collect();
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

/// Returns pairs of views whose rays are at least half of `min_angle` apart, widest first.
fn pairs_by_angle(views: &[RayObservation], min_angle: f64) -> Vec<[usize; 2]> {
    let directions: Vec<DVec3> = views.iter().map(RayObservation::direction).collect();
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
    // A right angle is best; beyond it, rays become parallel again.
    pairs.sort_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
    pairs.into_iter().map(|(pair, _)| pair).collect()
}

#[cfg(test)]
mod tests;

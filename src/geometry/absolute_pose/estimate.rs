use glam::{DVec2, DVec3};

use super::refine::{Reprojection, refined};
use super::seen::{Blocks, PointObservation, seen};
use crate::ransac::{Estimator, RansacOptions, consensus};
use crate::solvers::{minimise, p3p};
use crate::{Camera, Pose};

/// Options of [`estimate_absolute_pose`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AbsolutePoseOptions {
    /// Maximum reprojection error of an inlier, pixels.
    pub max_error_px: f64,
    /// Required probability of having drawn a sample without outliers.
    pub confidence: f64,
    /// Maximum number of samples.
    pub max_iterations: usize,
    /// Minimum number of inliers of an accepted pose.
    pub min_inliers: usize,
    /// Seed of the samples.
    pub seed: u64,
}

impl Default for AbsolutePoseOptions {
    fn default() -> Self {
        Self {
            max_error_px: 12.0,
            confidence: 0.999,
            max_iterations: 10_000,
            min_inliers: 30,
            seed: 0,
        }
    }
}

/// Pose of a camera and the points that support it.
#[derive(Debug, Clone, PartialEq)]
pub struct AbsolutePose {
    /// Estimated pose.
    pub camera_from_world: Pose,
    /// Indices of the inliers, ascending.
    pub inliers: Vec<u32>,
}

/// Maximum number of steps and of points of a refinement between samples.
const QUICK_STEPS: usize = 6;
const QUICK_POINTS: usize = 300;
/// A wrong pose explains the points of its sample, and a few more by chance: up to this many.
const BY_CHANCE: usize = 6;

/// Estimates the pose of a camera that sees `points[i]` (world space) at `at_px[i]`.
///
/// Some correspondences may be wrong: samples of three points are drawn (P3P in RANSAC), and the
/// best pose is refined over its inliers. Returns `None` if fewer than `min_inliers` agree, or if
/// all inliers lie in one line.
#[must_use]
pub fn estimate_absolute_pose(
    camera: &Camera,
    at_px: &[DVec2],
    points: &[DVec3],
    options: &AbsolutePoseOptions,
) -> Option<AbsolutePose> {
    let seen = seen(camera, at_px, points);
    let (pose, places) = pose_of(camera, &seen, options)?;
    let inliers = places
        .iter()
        .map(|&place| seen[place as usize].given)
        .collect();
    Some(AbsolutePose {
        camera_from_world: pose,
        inliers,
    })
}

/// Returns the pose and the indices of the inliers.
pub(super) fn pose_of(
    camera: &Camera,
    seen: &[PointObservation],
    options: &AbsolutePoseOptions,
) -> Option<(Pose, Vec<u32>)> {
    let search = Resection {
        camera,
        seen,
        blocks: Blocks::new(seen, options.max_error_px),
    };
    let &AbsolutePoseOptions {
        confidence,
        max_iterations,
        seed,
        ..
    } = options;
    let min_inliers = options.min_inliers.max(BY_CHANCE);
    let ransac = RansacOptions {
        confidence,
        max_iterations,
        max_vain: max_iterations,
        min_inliers,
        seed,
    };
    let found = consensus(&search, &ransac)?;
    if in_one_line(
        found
            .inliers
            .iter()
            .map(|&place| seen[place as usize].point),
    ) {
        return None;
    }
    let pose = refined(camera, &found.model, &chosen(seen, &found.inliers), 20);
    let inliers = search.blocks.within(&pose);
    (inliers.len() >= min_inliers).then_some((pose, inliers))
}

pub(super) fn chosen(seen: &[PointObservation], places: &[u32]) -> Vec<PointObservation> {
    places.iter().map(|&place| seen[place as usize]).collect()
}

/// Returns whether points are so close to a line that a camera may rotate about it.
fn in_one_line(points: impl Iterator<Item = DVec3> + Clone) -> bool {
    let count = points.clone().count() as f64;
    let mean = points.clone().sum::<DVec3>() / count;
    let longest = points.clone().map(|x| x - mean).fold(DVec3::ZERO, |a, b| {
        if b.length() > a.length() { b } else { a }
    });
    let Some(along) = longest.try_normalize() else {
        return true;
    };
    let off = points
        .map(|x| (x - mean).reject_from_normalized(along).length_squared())
        .sum::<f64>()
        / count;
    off.is_nan() || off.sqrt() <= 1e-4 * longest.length()
}

struct Resection<'a> {
    camera: &'a Camera,
    seen: &'a [PointObservation],
    blocks: Blocks,
}

impl Estimator for Resection<'_> {
    type Model = Pose;
    const SAMPLE: usize = 3;

    fn count(&self) -> usize {
        self.seen.len()
    }

    fn fit(&self, sample: &[usize], found: &mut Vec<Pose>) {
        let drawn = [sample[0], sample[1], sample[2]].map(|place| &self.seen[place]);
        found.extend(p3p(&drawn.map(|one| one.ray), &drawn.map(|one| one.point)));
    }

    fn cost(&self, pose: &Pose, enough: f64) -> f64 {
        self.blocks.cost(pose, enough)
    }

    fn inliers(&self, pose: &Pose) -> Vec<u32> {
        self.blocks.within(pose)
    }

    fn refine(&self, pose: &Pose) -> Option<Pose> {
        let inliers = self.blocks.within(pose);
        let every = inliers.len().div_ceil(QUICK_POINTS).max(1);
        let some: Vec<u32> = inliers.into_iter().step_by(every).collect();
        (some.len() > Self::SAMPLE)
            .then(|| refined(self.camera, pose, &chosen(self.seen, &some), QUICK_STEPS))
    }
}

/// Maximum number of Levenberg–Marquardt steps over pose and focal length.
const STEPS: usize = 50;
/// Number of times the inliers are selected again.
const ROUNDS: usize = 2;

/// Estimates the pose of a camera whose focal length is only a guess.
///
/// Each of the `factors` on the guess is tried. The focal length with the most inliers is refined
/// together with the pose. The first value returned is the factor on the guess. Returns `None` if
/// no factor gives `min_inliers` inliers.
#[must_use]
pub fn estimate_absolute_pose_and_focal(
    camera: &Camera,
    factors: &[f64],
    at_px: &[DVec2],
    points: &[DVec3],
    options: &AbsolutePoseOptions,
) -> Option<(f64, AbsolutePose)> {
    let mut best: Option<FocalCandidate> = None;
    for &factor in factors
        .iter()
        .filter(|factor| factor.is_finite() && **factor > 0.0)
    {
        let camera = Camera {
            focal_px: camera.focal_px * factor,
            ..*camera
        };
        let seen = seen(&camera, at_px, points);
        if let Some((pose, inliers)) = pose_of(&camera, &seen, options)
            && best
                .as_ref()
                .is_none_or(|b| inliers.len() > b.inliers.len())
        {
            best = Some(FocalCandidate {
                camera,
                seen,
                pose,
                inliers,
            });
        }
    }
    let mut found = best?;
    for _ in 0..ROUNDS {
        found = found
            .with_focal_refined(at_px, points, options)
            .unwrap_or(found);
    }
    let inliers = found
        .inliers
        .iter()
        .map(|&place| found.seen[place as usize].given)
        .collect();
    let factor = found.camera.focal_px.x / camera.focal_px.x;
    Some((
        factor,
        AbsolutePose {
            camera_from_world: found.pose,
            inliers,
        },
    ))
}

/// A camera's pose for one focal length.
struct FocalCandidate {
    camera: Camera,
    seen: Vec<PointObservation>,
    pose: crate::Pose,
    inliers: Vec<u32>,
}

impl FocalCandidate {
    /// Refines focal length and pose over the inliers; returns `None` if that loses inliers.
    fn with_focal_refined(
        &self,
        at_px: &[DVec2],
        points: &[DVec3],
        options: &AbsolutePoseOptions,
    ) -> Option<Self> {
        let chosen = chosen(&self.seen, &self.inliers);
        let start = Reprojection {
            camera: self.camera,
            pose: self.pose,
            seen: &chosen,
        };
        let Reprojection { camera, pose, .. } = minimise::<7, _>(start, STEPS);
        let seen = seen(&camera, at_px, points);
        let inliers = Blocks::new(&seen, options.max_error_px).within(&pose);
        (inliers.len() >= self.inliers.len()).then_some(Self {
            camera,
            seen,
            pose,
            inliers,
        })
    }
}

use glam::{DVec2, DVec3};

use super::estimate::{AbsolutePose, AbsolutePoseOptions, chosen, pose_of};
use super::refine::Reprojection;
use super::seen::{Blocks, Seen, seen};
use crate::Camera;
use crate::solvers::minimise;

/// Levenberg–Marquardt steps over pose and focal length.
const STEPS: usize = 50;
/// How often the inliers are chosen anew.
const ROUNDS: usize = 2;

/// Pose of a camera whose focal length is only guessed: each of the `factors` on the guess is tried, and that with most
/// inliers refined together with the pose. The first value is what the guess is to be multiplied by. `None` where no
/// factor brings `min_inliers` to agree.
#[must_use]
pub fn estimate_absolute_pose_and_focal(
    camera: &Camera,
    factors: &[f64],
    at_px: &[DVec2],
    points: &[DVec3],
    options: &AbsolutePoseOptions,
) -> Option<(f64, AbsolutePose)> {
    let mut best: Option<Found> = None;
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
            best = Some(Found {
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

/// A camera's pose with one focal length.
struct Found {
    camera: Camera,
    seen: Vec<Seen>,
    pose: crate::Pose,
    inliers: Vec<u32>,
}

impl Found {
    /// Focal length and pose refined over the inliers; `None` where that loses inliers.
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

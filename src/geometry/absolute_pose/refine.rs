use glam::{DQuat, DVec2, DVec3};

use super::seen::{PointObservation, seen};
use crate::solvers::{Linearised, Problem, minimise};
use crate::{Camera, Pose};

/// Maximum number of Levenberg–Marquardt steps.
const STEPS: usize = 20;
/// Scale of Cauchy's loss, pixels.
const RESIDUAL_SCALE_PX: f64 = 1.0;

/// Refines a pose to the least reprojection error under Cauchy's loss (scale 1 px).
///
/// Lens distortion is included. Points that are not finite are skipped. Returns `start` if fewer
/// than three points remain.
#[must_use]
pub fn refine_absolute_pose(
    camera: &Camera,
    start: &Pose,
    at_px: &[DVec2],
    points: &[DVec3],
) -> Pose {
    refined(camera, start, &seen(camera, at_px, points), STEPS)
}

pub(super) fn refined(
    camera: &Camera,
    start: &Pose,
    seen: &[PointObservation],
    max_steps: usize,
) -> Pose {
    if seen.len() < 3 {
        return *start;
    }
    minimise::<6, _>(
        Reprojection {
            camera: *camera,
            pose: *start,
            seen,
        },
        max_steps,
    )
    .pose
}

/// Reprojection problem over the pose, or the pose and focal length, of a camera.
pub(super) struct Reprojection<'a> {
    pub camera: Camera,
    pub pose: Pose,
    pub seen: &'a [PointObservation],
}

/// Cost of a point behind the camera or outside the lens model, square pixels.
const UNSEEN: f64 = 1e6;

/// Contribution of one point to the linearised problem.
struct LinearisedPoint {
    miss: DVec2,
    /// Derivative of the pixel position by a translation of the point in camera space.
    shift: [DVec3; 2],
    /// The point, rotated into the camera's axes.
    turned: DVec3,
    /// Position relative to the principal point, pixels.
    from_centre: DVec2,
    weight: f64,
}

impl Reprojection<'_> {
    /// Calls `add` for every point that the camera sees; returns the total cost.
    fn each(&self, mut add: impl FnMut(&LinearisedPoint)) -> f64 {
        const SCALE: f64 = RESIDUAL_SCALE_PX * RESIDUAL_SCALE_PX;
        let mut cost = 0.0;
        for one in self.seen {
            let turned = self.pose.rotation * one.point;
            let x = turned + self.pose.translation;
            let Some(at) = self.camera.project(x) else {
                cost += SCALE * (UNSEEN / SCALE).ln_1p();
                continue;
            };
            let miss = at - one.at_px;
            let relative_cost = miss.length_squared() / SCALE;
            cost += SCALE * relative_cost.ln_1p();
            let plane = [
                DVec3::new(1.0, 0.0, -x.x / x.z) / x.z,
                DVec3::new(0.0, 1.0, -x.y / x.z) / x.z,
            ];
            let (u, v) = (one.slope.x_axis, one.slope.y_axis);
            let shift = [
                plane[0] * u.x + plane[1] * v.x,
                plane[0] * u.y + plane[1] * v.y,
            ];
            let from_centre = at - self.camera.principal_px;
            add(&LinearisedPoint {
                miss,
                shift,
                turned,
                from_centre,
                weight: (1.0 + relative_cost).recip(),
            });
        }
        cost
    }

    fn moved_pose(&self, turn: [f64; 3], shift: [f64; 3]) -> Pose {
        Pose {
            rotation: (DQuat::from_scaled_axis(turn.into()) * self.pose.rotation).normalize(),
            translation: self.pose.translation + DVec3::from(shift),
        }
    }
}

impl Problem<6> for Reprojection<'_> {
    fn linearise(&self) -> Linearised<6> {
        let mut sum = Linearised::ZERO;
        sum.cost = self.each(|row| {
            for (i, shift) in row.shift.into_iter().enumerate() {
                let turn = row.turned.cross(shift);
                sum.add(
                    row.miss[i],
                    &[turn.x, turn.y, turn.z, shift.x, shift.y, shift.z],
                    row.weight,
                );
            }
        });
        sum
    }

    fn moved(&self, step: &[f64; 6]) -> Self {
        let pose = self.moved_pose([step[0], step[1], step[2]], [step[3], step[4], step[5]]);
        Self { pose, ..*self }
    }
}

/// The seventh parameter is the logarithm of the focal length.
impl Problem<7> for Reprojection<'_> {
    fn linearise(&self) -> Linearised<7> {
        let mut sum = Linearised::ZERO;
        sum.cost = self.each(|row| {
            for (i, shift) in row.shift.into_iter().enumerate() {
                let turn = row.turned.cross(shift);
                let slope = [
                    turn.x,
                    turn.y,
                    turn.z,
                    shift.x,
                    shift.y,
                    shift.z,
                    row.from_centre[i],
                ];
                sum.add(row.miss[i], &slope, row.weight);
            }
        });
        sum
    }

    fn moved(&self, step: &[f64; 7]) -> Self {
        let pose = self.moved_pose([step[0], step[1], step[2]], [step[3], step[4], step[5]]);
        let camera = Camera {
            focal_px: self.camera.focal_px * step[6].exp(),
            ..self.camera
        };
        Self {
            camera,
            pose,
            seen: self.seen,
        }
    }
}

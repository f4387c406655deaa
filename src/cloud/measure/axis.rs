use glam::{DVec2, DVec3};
use nalgebra::{Matrix4, Vector4};

use ostra_core::statistics::upper_median;

/// A straight axis: a point on it and its unit direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Axis {
    pub(super) x: DVec3,
    pub(super) along: DVec3,
}

/// Maximum number of iterations of the fit.
const STEPS: usize = 30;
/// Share of the normal matrix's trace that is added to its diagonal.
///
/// Parameters that the points of a narrow strip do not determine stay unchanged.
const DAMPING: f64 = 1e-3;
/// Minimum number of points that determine a cylinder.
const LEAST_POINTS: usize = 8;
/// Minimum cosine between the fitted and the initial axis; beyond it the fit is not determined.
const LEAST_COSINE: f64 = 0.9;

impl Axis {
    /// Fits the axis of a cylinder of known radius to the points within `reach` of `self.x`.
    ///
    /// The reach is measured along the axis. The fit minimises squared distances from the surface
    /// by damped Gauss-Newton iterations, without points beyond 2.5 median distances. As the radius
    /// is known, points on one side suffice. Returns `self` if the points do not determine an axis.
    pub(super) fn fitted(self, points: &[DVec3], radius: f64, reach: f64) -> Self {
        let within = reach + 2.0 * radius;
        let near: Vec<DVec3> = points
            .iter()
            .copied()
            .filter(|x| x.distance(self.x) <= within)
            .collect();
        let mut axis = self;
        for _ in 0..STEPS {
            let Some((next, moved)) = axis.step(&near, radius, reach) else {
                return self;
            };
            axis = next;
            if moved < 1e-9 * radius {
                break;
            }
        }
        if axis.along.dot(self.along) >= LEAST_COSINE && axis.x.distance(self.x) <= 2.0 * radius {
            axis
        } else {
            self
        }
    }

    /// Performs one iteration; returns the new axis and how far it moved within the reach.
    fn step(self, points: &[DVec3], radius: f64, reach: f64) -> Option<(Self, f64)> {
        let (u, v) = self.along.any_orthonormal_pair();
        let near = points
            .iter()
            .map(|&x| x - self.x)
            .filter(|offset| offset.dot(self.along).abs() <= reach);
        // Per point: unit direction from the axis, position along it as a share of the reach,
        // distance from the surface.
        let rows: Vec<(DVec2, f64, f64)> = near
            .map(|offset| {
                let across = DVec2::new(offset.dot(u), offset.dot(v));
                (
                    across.normalize_or_zero(),
                    offset.dot(self.along) / reach,
                    across.length() - radius,
                )
            })
            .collect();
        let mut distances: Vec<f64> = rows.iter().map(|row| row.2.abs()).collect();
        if distances.len() < LEAST_POINTS {
            return None;
        }
        let limit = 2.5 * upper_median(&mut distances)? + 1e-12;
        let (mut normal, mut right) = (Matrix4::<f64>::zeros(), Vector4::<f64>::zeros());
        for (away, share, distance) in rows.into_iter().filter(|row| row.2.abs() <= limit) {
            let row = Vector4::new(away.x, away.y, share * away.x, share * away.y);
            normal += row * row.transpose();
            right += row * distance;
        }
        normal += Matrix4::identity() * (DAMPING * normal.trace());
        let step = normal.cholesky()?.solve(&right);
        let x = self.x + step[0] * u + step[1] * v;
        let along = (self.along + (step[2] * u + step[3] * v) / reach).normalize();
        (x.is_finite() && along.is_finite()).then_some((Self { x, along }, step.norm()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a strip of a cylinder of radius 2.5 about `axis`.
    ///
    /// It covers `arc` radians and extends up to 30 on both sides.
    fn strip(axis: Axis, arc: impl Fn(f64) -> f64) -> Vec<DVec3> {
        let (u, v) = axis.along.any_orthonormal_pair();
        let point = |k: u32| {
            let along = -30.0 + 0.02 * f64::from(k);
            let (sin, cos) = (arc(along) * (0.618_034 * f64::from(k)).fract()).sin_cos();
            axis.x + along * axis.along + 2.5 * (cos * u + sin * v)
        };
        (0..3000).map(point).collect()
    }

    #[test]
    fn axis_is_recovered_from_points_on_one_side() {
        let axis = Axis {
            x: DVec3::new(3.0, -1.0, 8.0),
            along: DVec3::new(0.2, 0.1, 1.0).normalize(),
        };
        // The visible side narrows upwards, so that the middle of the visible points leans.
        let seen = strip(axis, |along| 2.4 - 0.02 * along);
        let begin = Axis {
            x: axis.x + DVec3::new(1.0, 0.6, 0.0),
            along: DVec3::new(0.28, 0.05, 1.0).normalize(),
        };
        let found = begin.fitted(&seen, 2.5, 30.0);
        assert!(
            found.along.angle_between(axis.along).to_degrees() < 0.1,
            "{found:?}"
        );
        assert!(
            (found.x - axis.x)
                .reject_from_normalized(axis.along)
                .length()
                < 0.02,
            "{found:?}"
        );
    }

    #[test]
    fn too_few_points_leave_the_axis_unchanged() {
        let axis = Axis {
            x: DVec3::ZERO,
            along: DVec3::Z,
        };
        assert_eq!(axis.fitted(&[DVec3::X; 7], 2.5, 30.0), axis);
        assert_eq!(
            axis.fitted(&[DVec3::new(40.0, 0.0, 0.0); 20], 2.5, 30.0),
            axis
        );
    }
}

use glam::{DMat3, DQuat, DVec3};
use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

use super::{GeometryError, Pose};

/// Degrees of freedom of the alignment of one set of points to another.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Alignment {
    /// No alignment: both are in the same space already.
    #[default]
    None,
    /// Rotation and translation.
    Se3,
    /// Rotation, translation and scale.
    Sim3,
}

/// A similarity transform: `x_in_target = scale · rotation · x_in_source + translation`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Similarity {
    /// Scale, above 0.
    pub scale: f64,
    /// Rotation, a unit quaternion.
    pub rotation: DQuat,
    /// Translation, in units of the target space.
    pub translation: DVec3,
}

/// Ratio of singular values below which points are collinear (a width of 1e-5 of the length).
const LINE_RATIO: f64 = 1e-10;

impl Similarity {
    /// The identity transform.
    pub const IDENTITY: Self = Self {
        scale: 1.0,
        rotation: DQuat::IDENTITY,
        translation: DVec3::ZERO,
    };

    /// Estimates the least-squares transform from `source[i]` to `target[i]`.
    ///
    /// W. Kabsch, *A solution for the best rotation to relate two sets of vectors*, Acta Cryst. A
    /// 1976, with the scale of S. Umeyama, *Least-squares estimation of transformation parameters
    /// between two point patterns*, PAMI 1991.
    ///
    /// # Errors
    /// [`GeometryError::TooFewPoints`] for fewer than three points, or if all are in one place or
    /// line; [`GeometryError::Unpaired`] for lists of unequal length; [`GeometryError::NotFinite`].
    /// `Alignment::None` needs no points.
    pub fn align(
        source: &[DVec3],
        target: &[DVec3],
        alignment: Alignment,
    ) -> Result<Self, GeometryError> {
        if source.len() != target.len() {
            return Err(GeometryError::Unpaired {
                what: "points",
                left: source.len(),
                right: target.len(),
            });
        }
        if !source.iter().chain(target).all(|x| x.is_finite()) {
            return Err(GeometryError::NotFinite {
                what: "list of points to align".into(),
            });
        }
        match alignment {
            Alignment::None => Ok(Self::IDENTITY),
            Alignment::Se3 => {
                least_squares(source, target, false).ok_or(GeometryError::TooFewPoints {
                    count: source.len(),
                    kind: "se3",
                })
            }
            Alignment::Sim3 => {
                least_squares(source, target, true).ok_or(GeometryError::TooFewPoints {
                    count: source.len(),
                    kind: "sim3",
                })
            }
        }
    }

    /// Estimates scale and translation from `source[i]` to `target[i]` for a given rotation.
    ///
    /// Both sides need the same number of points, not all in one place if a scale is estimated.
    pub(super) fn turned(
        source: &[DVec3],
        target: &[DVec3],
        rotation: DQuat,
        alignment: Alignment,
    ) -> Self {
        let mean = |points: &[DVec3]| points.iter().sum::<DVec3>() / points.len().max(1) as f64;
        let (source_mean, target_mean) = (mean(source), mean(target));
        let pairs = || {
            source
                .iter()
                .zip(target)
                .map(|(s, t)| (rotation * (*s - source_mean), *t - target_mean))
        };
        let spread: f64 = pairs().map(|(s, _)| s.length_squared()).sum();
        let scale = match alignment {
            Alignment::None => return Self::IDENTITY,
            Alignment::Se3 => 1.0,
            Alignment::Sim3 => pairs().map(|(s, t)| s.dot(t)).sum::<f64>() / spread,
        };
        Self {
            scale,
            rotation,
            translation: target_mean - scale * (rotation * source_mean),
        }
    }

    /// Transforms a point from the source space to the target space.
    #[must_use]
    pub fn transform(&self, x_in_source: DVec3) -> DVec3 {
        self.scale * (self.rotation * x_in_source) + self.translation
    }

    /// Converts `camera_from_source` to `camera_from_target`; camera space takes the target's unit.
    #[must_use]
    pub fn transform_camera(&self, camera_from_source: &Pose) -> Pose {
        let rotation = (camera_from_source.rotation * self.rotation.conjugate()).normalize();
        let centre = self.transform(camera_from_source.centre());
        Pose {
            rotation,
            translation: -(rotation * centre),
        }
    }

    /// Returns the inverse, `source_from_target`.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.conjugate();
        Self {
            scale: 1.0 / self.scale,
            rotation,
            translation: -(rotation * self.translation) / self.scale,
        }
    }
}

fn least_squares(source: &[DVec3], target: &[DVec3], with_scale: bool) -> Option<Similarity> {
    let count = source.len() as f64;
    let mean = |points: &[DVec3]| points.iter().sum::<DVec3>() / count;
    let (source_mean, target_mean) = (mean(source), mean(target));
    let mut covariance = DMat3::ZERO;
    for (s, t) in source.iter().zip(target) {
        let (s, t) = (*s - source_mean, *t - target_mean);
        covariance += DMat3::from_cols(t * s.x, t * s.y, t * s.z);
    }
    let svd = Matrix3::from_column_slice(&covariance.to_cols_array()).svd(true, true);
    let (u, vt, sigma) = (svd.u?, svd.v_t?, svd.singular_values);
    if source.len() < 3 || sigma[0].is_nan() || sigma[0] <= 0.0 || sigma[1] <= LINE_RATIO * sigma[0]
    {
        return None;
    }
    let flip = if (u * vt).determinant() < 0.0 {
        -1.0
    } else {
        1.0
    };
    let signs = Matrix3::from_diagonal(&nalgebra::Vector3::new(1.0, 1.0, flip));
    let r = u * signs * vt;
    let spread: f64 = source.iter().map(|s| s.distance_squared(source_mean)).sum();
    let scale = if with_scale {
        (sigma[0] + sigma[1] + flip * sigma[2]) / spread
    } else {
        1.0
    };
    let rotation = DQuat::from_mat3(&DMat3::from_cols_slice(r.as_slice())).normalize();
    Some(Similarity {
        scale,
        rotation,
        translation: target_mean - scale * (rotation * source_mean),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn point() -> impl Strategy<Value = DVec3> {
        (-5.0..5.0f64, -5.0..5.0f64, -5.0..5.0f64).prop_map(|(x, y, z)| DVec3::new(x, y, z))
    }

    proptest! {
        #[test]
        fn known_similarity_is_recovered(
            points in prop::collection::vec(point(), 4..30),
            axis in point(), angle in -3.0..3.0f64, scale in 0.01..50.0f64, translation in point(),
        ) {
            prop_assume!(axis.length() > 0.1);
            let truth = Similarity { scale, rotation: DQuat::from_axis_angle(axis.normalize(), angle), translation };
            let target: Vec<DVec3> = points.iter().map(|&x| truth.transform(x)).collect();
            let found = Similarity::align(&points, &target, Alignment::Sim3).unwrap();
            for (&x, &t) in points.iter().zip(&target) {
                prop_assert!(found.transform(x).abs_diff_eq(t, 1e-6 * scale.max(1.0)));
                prop_assert!(found.inverse().transform(t).abs_diff_eq(x, 1e-6));
            }
            prop_assert!((found.scale / scale - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn coplanar_points_are_aligned_by_a_rotation_without_mirroring() {
        let source = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::new(1.0, 2.0, 0.0)];
        let turn = DQuat::from_rotation_x(2.0);
        let target = source.map(|x| turn * x + DVec3::Z);
        let found = Similarity::align(&source, &target, Alignment::Se3).unwrap();
        assert!(
            found
                .transform(DVec3::Z)
                .abs_diff_eq(turn * DVec3::Z + DVec3::Z, 1e-9)
        );
        assert_eq!(found.scale, 1.0);
    }

    #[test]
    fn collinear_and_coincident_points_are_rejected() {
        let line: Vec<DVec3> = (0..9)
            .map(|i| DVec3::new(f64::from(i), 2.0 * f64::from(i), 1.0))
            .collect();
        for alignment in [Alignment::Se3, Alignment::Sim3] {
            assert!(Similarity::align(&line, &line, alignment).is_err());
            assert!(Similarity::align(&[DVec3::ONE; 5], &[DVec3::ONE; 5], alignment).is_err());
            assert!(Similarity::align(&line[..2], &line[..2], alignment).is_err());
        }
        assert!(Similarity::align(&[], &[], Alignment::None).is_ok());
        assert!(Similarity::align(&line, &line[1..], Alignment::None).is_err());
        assert!(Similarity::align(&[DVec3::NAN; 3], &[DVec3::ONE; 3], Alignment::Sim3).is_err());
    }

    #[test]
    fn aligned_camera_sees_the_aligned_point_at_the_same_position() {
        let world = Similarity {
            scale: 3.0,
            rotation: DQuat::from_rotation_z(1.0),
            translation: DVec3::new(1.0, 2.0, 3.0),
        };
        let camera = Pose {
            rotation: DQuat::from_rotation_y(0.4),
            translation: DVec3::new(0.1, 0.2, 4.0),
        };
        let x = DVec3::new(0.3, -0.7, 1.9);
        let before = camera.transform(x);
        let after = world
            .transform_camera(&camera)
            .transform(world.transform(x));
        assert!(after.abs_diff_eq(3.0 * before, 1e-12));
    }
}

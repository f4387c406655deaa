use glam::{DMat3, DMat4, DQuat, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::GeometryError;

/// A rigid transform `target_from_source`: `x_in_target = rotation · x_in_source + translation`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Pose {
    /// Rotation, a unit quaternion.
    #[schemars(with = "[f64; 4]")]
    pub rotation: DQuat,
    /// Translation, in units of the target space.
    #[schemars(with = "[f64; 3]")]
    pub translation: DVec3,
}

impl Default for Pose {
    fn default() -> Self {
        Self::IDENTITY
    }
}

impl Pose {
    /// The identity transform.
    pub const IDENTITY: Self = Self {
        rotation: DQuat::IDENTITY,
        translation: DVec3::ZERO,
    };

    /// Creates a pose from a 3×3 matrix that is a rotation up to rounding in a file.
    ///
    /// Real files have errors of 2e-4; the nearest rotation is taken.
    ///
    /// # Errors
    /// [`GeometryError::NotFinite`] for NaN or infinity, [`GeometryError::NotARotation`] beyond a
    /// distance of 0.05 (which includes reflections and scaled matrices).
    pub fn from_matrix(rotation: DMat3, translation: DVec3) -> Result<Self, GeometryError> {
        if !rotation.is_finite() || !translation.is_finite() {
            return Err(GeometryError::NotFinite {
                what: "pose".into(),
            });
        }
        let nearest = nearest_rotation(rotation);
        let difference = nearest - rotation;
        let error = difference
            .to_cols_array()
            .iter()
            .map(|v| v * v)
            .sum::<f64>()
            .sqrt();
        if error > 0.05 {
            return Err(GeometryError::NotARotation { error });
        }
        Ok(Self {
            rotation: DQuat::from_mat3(&nearest).normalize(),
            translation,
        })
    }

    /// Returns the inverse, `source_from_target`.
    #[must_use]
    #[inline]
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.conjugate();
        Self {
            rotation,
            translation: -(rotation * self.translation),
        }
    }

    /// Returns `self · other`: first `other`, then `self`.
    #[must_use]
    #[inline]
    pub fn compose(&self, other: &Self) -> Self {
        Self {
            rotation: (self.rotation * other.rotation).normalize(),
            translation: self.rotation * other.translation + self.translation,
        }
    }

    /// Transforms a point from the source space to the target space.
    #[must_use]
    #[inline]
    pub fn transform(&self, x_in_source: DVec3) -> DVec3 {
        self.rotation * x_in_source + self.translation
    }

    /// Returns the camera centre in world space, if `self` is `camera_from_world`.
    #[must_use]
    #[inline]
    pub fn centre(&self) -> DVec3 {
        -(self.rotation.conjugate() * self.translation)
    }

    /// Returns `camera_from_world` for a world with coordinates relative to `origin`.
    ///
    /// The negative origin reverses this.
    #[must_use]
    #[inline]
    pub fn relative_to(&self, origin: DVec3) -> Self {
        Self {
            rotation: self.rotation,
            translation: self.rotation * origin + self.translation,
        }
    }

    /// Returns the 4×4 matrix of the transform.
    #[must_use]
    #[inline]
    pub fn matrix(&self) -> DMat4 {
        DMat4::from_rotation_translation(self.rotation, self.translation)
    }
}

/// Returns the rotation nearest to `matrix` in Frobenius norm (polar decomposition by SVD).
pub(super) fn nearest_rotation(matrix: DMat3) -> DMat3 {
    let m = nalgebra::Matrix3::from_column_slice(&matrix.to_cols_array());
    let svd = m.svd(true, true);
    let (Some(u), Some(mut vt)) = (svd.u, svd.v_t) else {
        return DMat3::IDENTITY;
    };
    if (u * vt).determinant() < 0.0 {
        vt.row_mut(2).neg_mut();
    }
    let r = u * vt;
    DMat3::from_cols_slice(r.as_slice())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inexact_rotation_is_corrected() {
        let exact = DMat3::from_rotation_y(0.7);
        let off = exact + DMat3::from_cols_array(&[2e-4; 9]);
        let pose = Pose::from_matrix(off, DVec3::X).unwrap();
        let r = DMat3::from_quat(pose.rotation);
        assert!(
            (r * r.transpose() - DMat3::IDENTITY)
                .to_cols_array()
                .iter()
                .all(|v| v.abs() < 1e-12)
        );
        assert!(r.abs_diff_eq(exact, 1e-3));
    }

    #[test]
    fn reflection_and_nan_are_rejected() {
        assert!(
            Pose::from_matrix(
                DMat3::from_diagonal(DVec3::new(1.0, 1.0, -1.0)),
                DVec3::ZERO
            )
            .is_err()
        );
        assert!(Pose::from_matrix(DMat3::IDENTITY, DVec3::NAN).is_err());
    }

    #[test]
    fn poses_relative_to_a_far_origin_keep_micrometres() {
        let pose = Pose {
            rotation: DQuat::from_rotation_x(0.3),
            translation: DVec3::new(1.0, 2.0, 3.0),
        };
        let origin = DVec3::new(500_000.0, 5_400_000.0, 300.0);
        let global = pose.relative_to(-origin);
        assert!(global.centre().abs_diff_eq(pose.centre() + origin, 1e-6));
        assert!(
            global
                .relative_to(origin)
                .translation
                .abs_diff_eq(pose.translation, 1e-6)
        );
    }

    #[test]
    fn inverse_and_centre_are_consistent() {
        let pose = Pose {
            rotation: DQuat::from_rotation_x(0.3),
            translation: DVec3::new(1.0, 2.0, 3.0),
        };
        assert!(pose.transform(pose.centre()).length() < 1e-12);
        let x = DVec3::new(0.2, -4.0, 9.0);
        assert!(
            pose.inverse()
                .transform(pose.transform(x))
                .abs_diff_eq(x, 1e-12)
        );
    }
}

use glam::{DMat2, DQuat, DVec2, DVec3, Vec2Swizzles};

use super::{Camera, GeometryError, Pose};

/// A rotation of an image by a multiple of 90°, as seen by the viewer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum QuarterRotation {
    /// No rotation.
    #[default]
    None,
    /// 90° clockwise.
    Clockwise,
    /// 180°.
    Half,
    /// 90° anticlockwise.
    Anticlockwise,
}

impl QuarterRotation {
    /// Returns the rotation that shows a stored image of EXIF orientation `orientation` upright.
    ///
    /// # Errors
    /// [`GeometryError::Mirrored`] for 2, 4, 5 and 7 and for values other than 1 to 8: no pose
    /// mirrors an image.
    #[inline]
    pub fn from_exif(orientation: u8) -> Result<Self, GeometryError> {
        match orientation {
            1 => Ok(Self::None),
            3 => Ok(Self::Half),
            6 => Ok(Self::Clockwise),
            8 => Ok(Self::Anticlockwise),
            _ => Err(GeometryError::Mirrored { orientation }),
        }
    }

    /// Returns the inverse rotation.
    #[must_use]
    #[inline]
    pub fn inverse(self) -> Self {
        match self {
            Self::Clockwise => Self::Anticlockwise,
            Self::Anticlockwise => Self::Clockwise,
            Self::None | Self::Half => self,
        }
    }

    /// Rotates a position in an image of `width` × `height` pixels.
    #[must_use]
    #[inline]
    pub fn turn_px(self, at_px: DVec2, width: u32, height: u32) -> DVec2 {
        let (w, h) = (f64::from(width), f64::from(height));
        match self {
            Self::None => at_px,
            Self::Clockwise => DVec2::new(h - at_px.y, at_px.x),
            Self::Half => DVec2::new(w, h) - at_px,
            Self::Anticlockwise => DVec2::new(at_px.y, w - at_px.x),
        }
    }

    /// Returns the rotation of the plane z = 1 (x right, y down).
    fn matrix(self) -> DMat2 {
        match self {
            Self::None => DMat2::IDENTITY,
            Self::Clockwise => DMat2::from_cols(DVec2::Y, DVec2::NEG_X),
            Self::Half => DMat2::from_diagonal(DVec2::NEG_ONE),
            Self::Anticlockwise => DMat2::from_cols(DVec2::NEG_Y, DVec2::X),
        }
    }

    /// Returns the pose `turned_camera_from_camera`.
    #[must_use]
    #[inline]
    pub fn pose(self) -> Pose {
        let h = std::f64::consts::FRAC_1_SQRT_2;
        let rotation = match self {
            Self::None => DQuat::IDENTITY,
            Self::Clockwise => DQuat::from_xyzw(0.0, 0.0, h, h),
            Self::Half => DQuat::from_xyzw(0.0, 0.0, 1.0, 0.0),
            Self::Anticlockwise => DQuat::from_xyzw(0.0, 0.0, -h, h),
        };
        Pose {
            rotation,
            translation: DVec3::ZERO,
        }
    }
}

impl Camera {
    /// Returns the intrinsics of the rotated image; for the pose see [`Pose::turned`].
    #[must_use]
    pub fn turned(&self, turn: QuarterRotation) -> Self {
        if turn == QuarterRotation::None {
            return *self;
        }
        let principal_px = turn.turn_px(self.principal_px, self.width, self.height);
        let quarter = turn != QuarterRotation::Half;
        let (width, height) = if quarter {
            (self.height, self.width)
        } else {
            (self.width, self.height)
        };
        let focal_px = if quarter {
            self.focal_px.yx()
        } else {
            self.focal_px
        };
        Self {
            width,
            height,
            focal_px,
            principal_px,
            distortion: self.distortion.rotated(turn.matrix()),
        }
    }
}

impl Pose {
    /// Returns `camera_from_world` of the camera whose image was rotated.
    #[must_use]
    #[inline]
    pub fn turned(&self, turn: QuarterRotation) -> Self {
        if turn == QuarterRotation::None {
            *self
        } else {
            turn.pose().compose(self)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Distortion;

    fn camera() -> Camera {
        Camera {
            distortion: Distortion::ThinPrismFisheye {
                k: [0.02, -0.01, 0.003, 0.001],
                p: [0.004, -0.007],
                s: [0.003, 0.005],
            },
            ..Camera::pinhole(640, 480, [500.0, 520.0], [310.0, 250.0])
        }
    }

    #[test]
    fn rotated_camera_sees_the_rotated_image() {
        let (camera, pose) = (
            camera(),
            Pose {
                rotation: DQuat::from_rotation_y(0.2),
                translation: DVec3::Z,
            },
        );
        let x_in_world = DVec3::new(0.3, -0.4, 1.1);
        let stored = camera.project(pose.transform(x_in_world)).unwrap();
        let shown_at = |turn: QuarterRotation| {
            camera
                .turned(turn)
                .project(pose.turned(turn).transform(x_in_world))
                .unwrap()
        };
        let expected = [
            (QuarterRotation::None, stored),
            (
                QuarterRotation::Clockwise,
                DVec2::new(480.0 - stored.y, stored.x),
            ),
            (
                QuarterRotation::Half,
                DVec2::new(640.0 - stored.x, 480.0 - stored.y),
            ),
            (
                QuarterRotation::Anticlockwise,
                DVec2::new(stored.y, 640.0 - stored.x),
            ),
        ];
        for (turn, at_px) in expected {
            assert!(
                shown_at(turn).abs_diff_eq(at_px, 1e-9),
                "{turn:?}: {} is not {at_px}",
                shown_at(turn)
            );
        }
    }

    #[test]
    fn inverse_rotation_restores_the_camera() {
        for turn in [
            QuarterRotation::None,
            QuarterRotation::Clockwise,
            QuarterRotation::Half,
            QuarterRotation::Anticlockwise,
        ] {
            assert_eq!(camera().turned(turn).turned(turn.inverse()), camera());
            let pose = Pose {
                rotation: DQuat::from_rotation_x(0.4),
                translation: DVec3::ONE,
            };
            let back = pose.turned(turn).turned(turn.inverse());
            assert!(
                back.rotation.abs_diff_eq(pose.rotation, 1e-15)
                    || back.rotation.abs_diff_eq(-pose.rotation, 1e-15)
            );
            assert!(back.translation.abs_diff_eq(pose.translation, 1e-15));
        }
    }

    #[test]
    fn mirrored_orientations_are_rejected() {
        for orientation in [0, 2, 4, 5, 7, 9] {
            assert!(QuarterRotation::from_exif(orientation).is_err());
        }
        assert_eq!(
            QuarterRotation::from_exif(6),
            Ok(QuarterRotation::Clockwise)
        );
    }
}

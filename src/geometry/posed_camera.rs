//! Posed cameras, prepared to project many points.
//!
//! [`PosedCamera`] works in double precision and for every lens. [`Isometry`] and [`Pinhole`] are
//! for loops over the pixels of images without lens distortion, in single precision. They round
//! differently and do not replace it.

use glam::{DMat3, DVec2, DVec3, Mat3, Vec2, Vec3};

use super::{Camera, Distortion, Pose};

/// A camera at a pose, with the rotation as a matrix.
///
/// It is about twice as fast per point as [`Pose::transform`], and may differ from it in the last
/// bit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PosedCamera {
    /// Intrinsics.
    pub camera: Camera,
    /// Rotation of `camera_from_world`.
    pub rotation: DMat3,
    /// Translation of `camera_from_world`.
    pub translation: DVec3,
}

/// Projection of a point into a camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointProjection {
    /// Position in pixels, which may lie outside the image.
    pub at_px: DVec2,
    /// Depth along the optical axis, above 0.
    pub depth: f64,
}

impl PosedCamera {
    /// Creates a camera at `camera_from_world`.
    #[must_use]
    #[inline]
    pub fn new(camera: &Camera, camera_from_world: &Pose) -> Self {
        Self {
            camera: *camera,
            rotation: DMat3::from_quat(camera_from_world.rotation),
            translation: camera_from_world.translation,
        }
    }

    /// Returns the camera centre in world space.
    #[must_use]
    #[inline]
    pub fn centre(&self) -> DVec3 {
        self.rotation.transpose() * -self.translation
    }

    /// Transforms a point from world space to camera space.
    #[must_use]
    #[inline]
    pub fn transform(&self, x_in_world: DVec3) -> DVec3 {
        self.rotation * x_in_world + self.translation
    }

    /// Projects a point in world space; `None` if [`Camera::project`] returns `None`.
    ///
    /// The position may lie outside the image.
    #[must_use]
    #[inline(always)] // A call costs as much as the projection; the fusion projects every point into every frame.
    pub fn project(&self, x_in_world: DVec3) -> Option<PointProjection> {
        let x_in_camera = self.transform(x_in_world);
        let at_px = if matches!(self.camera.distortion, Distortion::None) {
            // Avoids looking up the terms of a lens for every point.
            if x_in_camera.z.is_nan() || x_in_camera.z <= 0.0 {
                return None;
            }
            x_in_camera.truncate() / x_in_camera.z * self.camera.focal_px + self.camera.principal_px
        } else {
            self.camera.project(x_in_camera)?
        };
        Some(PointProjection {
            at_px,
            depth: x_in_camera.z,
        })
    }

    /// Returns whether a ball in world space may be visible in the image.
    ///
    /// For lenses with distortion, only balls behind the camera are excluded.
    #[must_use]
    pub fn may_see(&self, centre: DVec3, radius: f64) -> bool {
        let c = self.transform(centre);
        if c.z + radius <= 0.0 {
            return false;
        }
        if !matches!(self.camera.distortion, Distortion::None) {
            return true;
        }
        let (focal, principal) = (self.camera.focal_px, self.camera.principal_px);
        let size = DVec2::new(f64::from(self.camera.width), f64::from(self.camera.height));
        // The four sides of the viewing pyramid as planes through the camera, normals pointing
        // inwards.
        let inside = |lateral: f64, focal: f64, towards: f64| {
            (focal * lateral + towards * c.z) / focal.hypot(towards) > -radius
        };
        inside(c.x, focal.x, principal.x)
            && inside(-c.x, focal.x, size.x - principal.x)
            && inside(c.y, focal.y, principal.y)
            && inside(-c.y, focal.y, size.y - principal.y)
    }

    /// Returns the size of a pixel at a depth, in world units.
    #[must_use]
    #[inline]
    pub fn footprint(&self, depth: f64) -> f64 {
        depth / self.camera.focal_px.max_element()
    }
}

/// A rigid transform in single precision; see [`Pose`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Isometry {
    /// Rotation, as a matrix.
    pub rotation: Mat3,
    /// Translation, in units of the target space.
    pub translation: Vec3,
}

impl From<&Pose> for Isometry {
    #[inline]
    fn from(pose: &Pose) -> Self {
        Self {
            rotation: Mat3::from_quat(pose.rotation.as_quat()),
            translation: pose.translation.as_vec3(),
        }
    }
}

impl Isometry {
    /// Transforms a point from the source space to the target space.
    #[must_use]
    #[inline]
    pub fn transform(&self, x_in_source: Vec3) -> Vec3 {
        self.rotation * x_in_source + self.translation
    }
}

/// A camera without lens distortion, in single precision.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pinhole {
    /// Focal lengths in pixels.
    pub focal: Vec2,
    /// Principal point in pixels.
    pub principal: Vec2,
    /// Columns and rows of the image.
    pub size: Vec2,
}

impl Pinhole {
    /// Returns the camera without its lens distortion.
    #[must_use]
    #[inline]
    pub fn new(camera: &Camera) -> Self {
        Self {
            focal: camera.focal_px.as_vec2(),
            principal: camera.principal_px.as_vec2(),
            size: Vec2::new(camera.width as f32, camera.height as f32),
        }
    }

    /// Projects a point in camera space to pixels; `None` behind the camera.
    ///
    /// The position may lie outside the image.
    #[must_use]
    #[inline]
    pub fn project(&self, x_in_camera: Vec3) -> Option<Vec2> {
        if x_in_camera.z <= 0.0 {
            return None;
        }
        Some(x_in_camera.truncate() / x_in_camera.z * self.focal + self.principal)
    }

    /// Same as [`Self::project`], for positions within the image only.
    #[must_use]
    #[inline]
    pub fn project_inside(&self, x_in_camera: Vec3) -> Option<Vec2> {
        self.project(x_in_camera)
            .filter(|at| at.x >= 0.0 && at.y >= 0.0 && at.x < self.size.x && at.y < self.size.y)
    }
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;

    fn pose() -> Pose {
        Pose {
            rotation: DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -0.2, 0.1),
            translation: DVec3::new(0.4, -0.1, 0.2),
        }
    }

    fn points() -> impl Iterator<Item = DVec3> {
        (0..200).map(|at| {
            let along = |step: u32| f64::from(at * step % 41) / 20.0 - 1.0;
            DVec3::new(along(7), along(11), 1.5 * along(13))
        })
    }

    #[test]
    fn projection_equals_that_of_camera_and_pose() {
        let pinhole = Camera::pinhole(160, 120, [110.0, 112.0], [83.0, 57.5]);
        let lens = Distortion::Radial { k: [-0.2, 0.03] };
        let distorted = Camera {
            distortion: lens,
            ..pinhole
        };
        for camera in [pinhole, distorted] {
            let posed = PosedCamera::new(&camera, &pose());
            for point in points() {
                let x_in_camera = pose().transform(point);
                let found = posed.project(point);
                assert_eq!(found.is_some(), camera.project(x_in_camera).is_some());
                if let Some((found, at_px)) = found.zip(camera.project(x_in_camera)) {
                    assert!(found.at_px.distance(at_px) < 1e-9 * (1.0 + at_px.length()));
                    assert!((found.depth - x_in_camera.z).abs() < 1e-12);
                }
            }
        }
    }

    #[test]
    fn points_without_a_projection_are_none() {
        let posed = PosedCamera::new(
            &Camera::pinhole(8, 8, [8.0, 8.0], [4.0, 4.0]),
            &Pose::IDENTITY,
        );
        for point in [DVec3::NAN, DVec3::ZERO, -DVec3::Z] {
            assert_eq!(posed.project(point), None);
        }
        let ahead = posed.project(DVec3::new(0.0, 0.0, 2.0)).unwrap();
        assert_eq!((ahead.at_px, ahead.depth), (DVec2::splat(4.0), 2.0));
        assert_eq!(posed.footprint(2.0), 0.25);
        assert!(
            PosedCamera::new(&posed.camera, &pose())
                .centre()
                .distance(pose().centre())
                < 1e-15
        );
    }

    #[test]
    fn ball_is_visible_if_one_of_its_points_is() {
        let camera = Camera::pinhole(160, 120, [110.0, 112.0], [83.0, 57.5]);
        let posed = PosedCamera::new(&camera, &pose());
        for point in points() {
            let is_inside = posed
                .project(point)
                .is_some_and(|seen| camera.contains(seen.at_px));
            assert!(!is_inside || posed.may_see(point, 0.0));
            let x_in_camera = posed.transform(point);
            assert!(x_in_camera.z > -0.1 || !posed.may_see(point, 0.1));
        }
        assert!(!posed.may_see(
            posed.centre() + pose().rotation.conjugate() * DVec3::new(9.0, 0.0, 1.0),
            0.5
        ));
        assert!(posed.may_see(posed.centre(), 1.0));
    }

    #[test]
    fn single_precision_is_close_to_double() {
        let camera = Camera::pinhole(160, 120, [110.0, 112.0], [83.0, 57.5]);
        let (posed, pinhole) = (PosedCamera::new(&camera, &pose()), Pinhole::new(&camera));
        let isometry = Isometry::from(&pose());
        let mut inside = 0;
        for point in points() {
            let x_in_camera = isometry.transform(point.as_vec3());
            let Some(exact) = posed.project(point).filter(|exact| exact.depth > 0.05) else {
                continue;
            };
            let at_px = pinhole.project(x_in_camera).unwrap();
            assert!(at_px.as_dvec2().distance(exact.at_px) < 0.01);
            let is_inside = camera.contains(at_px.as_dvec2());
            assert_eq!(pinhole.project_inside(x_in_camera).is_some(), is_inside);
            inside += usize::from(is_inside);
        }
        assert!(inside > 10, "{inside}");
        assert_eq!(pinhole.project(Vec3::new(0.0, 0.0, -1.0)), None);
    }
}

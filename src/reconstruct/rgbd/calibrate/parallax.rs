use glam::{DQuat, DVec2, DVec3, Mat2, Vec2, Vec3};
use nalgebra::{SMatrix, SVector};

use ostra_frames::DepthCamera;
use ostra_geometry::{Camera, Pose};

/// Number of unknowns of a [`Parallax`].
pub const UNKNOWNS: usize = 6;
/// One number for each unknown.
pub type Vector = SVector<f64, UNKNOWNS>;
/// One number for each pair of unknowns.
pub type Matrix = SMatrix<f64, UNKNOWNS, UNKNOWNS>;

/// Offset between images and the depths that they are assumed to be aligned with.
///
/// It consists of another focal length, a rotation about the axis, another principal point, and a
/// shifted camera.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Parallax {
    /// Logarithm of the image's focal length divided by the depth's.
    pub zoom: f32,
    /// Rotation about the optical axis, in radians.
    pub roll: f32,
    /// Shift of the principal point, on the plane at depth 1.
    pub shift: Vec2,
    /// Position of the depth's camera relative to the image's, in world units, across the optical axis.
    pub aside: Vec2,
}

impl Parallax {
    /// Creates it from its unknowns, in the order of the fields.
    #[must_use]
    pub fn of([zoom, roll, shift_x, shift_y, aside_x, aside_y]: [f32; UNKNOWNS]) -> Self {
        Self {
            zoom,
            roll,
            shift: Vec2::new(shift_x, shift_y),
            aside: Vec2::new(aside_x, aside_y),
        }
    }

    /// Projects a point in the depth camera's axes to the image.
    ///
    /// The result is on the plane at depth 1 of the camera that was assumed for the image.
    #[must_use]
    pub fn project(&self, point: Vec3) -> Vec2 {
        let adjacent = Mat2::from_angle(self.roll) * point.truncate() + self.aside;
        self.zoom.exp() * adjacent / point.z + self.shift
    }

    /// Returns the derivatives of the projection of a point by the unknowns.
    #[must_use]
    pub fn slopes(&self, point: Vec3) -> [Vec2; UNKNOWNS] {
        let larger = self.zoom.exp() / point.z;
        let turned = Mat2::from_angle(self.roll) * point.truncate();
        [
            larger * (turned + self.aside),
            larger * turned.perp(),
            Vec2::X,
            Vec2::Y,
            larger * Vec2::X,
            larger * Vec2::Y,
        ]
    }

    /// Returns the derivatives of the projection when the point is rotated about the depth camera's
    /// axes and shifted along them.
    #[must_use]
    pub fn slopes_of_pose(&self, point: Vec3) -> [Vec2; 6] {
        let turned = Mat2::from_angle(self.roll);
        let adjacent = turned * point.truncate() + self.aside;
        let moved = |by: Vec3| {
            self.zoom.exp() / point.z * (turned * by.truncate() - adjacent * (by.z / point.z))
        };
        let [x, y, z] = Vec3::AXES;
        [
            moved(x.cross(point)),
            moved(y.cross(point)),
            moved(z.cross(point)),
            moved(x),
            moved(y),
            moved(z),
        ]
    }

    /// Returns the camera of the images, and the depth's camera relative to it.
    ///
    /// `given` holds the intrinsics that were assumed for the images, which are the depth's.
    #[must_use]
    pub fn cameras(&self, given: &Camera) -> (Camera, DepthCamera) {
        let larger = f64::from(self.zoom).exp();
        let image = Camera {
            focal_px: given.focal_px * larger,
            principal_px: given.principal_px + self.shift.as_dvec2() * given.focal_px,
            ..*given
        };
        let image_from_depth = Pose {
            rotation: DQuat::from_rotation_z(self.roll.into()),
            translation: DVec3::from((self.aside.as_dvec2(), 0.0)),
        };
        (
            image,
            DepthCamera {
                intrinsics: *given,
                image_from_depth,
                estimated: true,
            },
        )
    }

    /// Returns the largest distance between images under both, as a share of the image's width, at depth `typical`.
    #[must_use]
    pub fn apart(&self, other: &Self, camera: &Camera, typical: f32) -> f64 {
        let off =
            |point: Vec3| (self.project(point) - other.project(point)).as_dvec2() * camera.focal_px;
        corners(camera, typical)
            .map(|point| off(point).length())
            .into_iter()
            .fold(0.0, f64::max)
            / f64::from(camera.width)
    }

    /// Returns the expected error of image positions for a covariance of the unknowns, in the
    /// measure of [`Self::apart`].
    #[must_use]
    pub fn uncertainty(&self, covariance: &Matrix, camera: &Camera, typical: f32) -> f64 {
        let square = |point: Vec3| {
            let slopes = self
                .slopes(point)
                .map(|slope| slope.as_dvec2() * camera.focal_px);
            let along = |axis: usize| Vector::from_fn(|unknown, _| slopes[unknown][axis]);
            [0, 1]
                .map(|axis| along(axis).dot(&(covariance * along(axis))))
                .iter()
                .sum::<f64>()
        };
        corners(camera, typical)
            .map(square)
            .into_iter()
            .fold(0.0, f64::max)
            .sqrt()
            / f64::from(camera.width)
    }
}

/// Returns the points at depth `typical` in the corners of a camera's images.
fn corners(camera: &Camera, typical: f32) -> [Vec3; 4] {
    let (width, height) = (f64::from(camera.width), f64::from(camera.height));
    [[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]]
        .map(|corner| camera.unproject(DVec2::from(corner)).as_vec2().extend(1.0) * typical)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PARALLAX: Parallax = Parallax {
        zoom: -0.1,
        roll: 0.01,
        shift: Vec2::new(0.002, -0.005),
        aside: Vec2::new(-0.026, 0.001),
    };

    #[test]
    fn cameras_project_like_the_parallax() {
        let given = Camera::pinhole(640, 480, [585.0, 580.0], [320.0, 240.0]);
        let (image, depth) = PARALLAX.cameras(&given);
        for point in [Vec3::new(0.4, -0.2, 1.5), Vec3::new(-0.5, 0.7, 3.0)] {
            let seen = image
                .project(depth.image_from_depth.transform(point.as_dvec3()))
                .unwrap();
            let message = given.focal_px * PARALLAX.project(point).as_dvec2() + given.principal_px;
            assert!(seen.abs_diff_eq(message, 1e-3), "{seen} is not {message}");
        }
    }

    #[test]
    fn slopes_match_small_steps() {
        let point = Vec3::new(0.4, -0.2, 1.5);
        let Parallax {
            zoom,
            roll,
            shift,
            aside,
        } = PARALLAX;
        for unknown in 0..UNKNOWNS {
            let by = |step: f32| {
                let mut unknowns = [zoom, roll, shift.x, shift.y, aside.x, aside.y];
                unknowns[unknown] += step;
                Parallax::of(unknowns).project(point)
            };
            let (measured, slope) = (
                (by(1e-2) - by(-1e-2)) / 2e-2,
                PARALLAX.slopes(point)[unknown],
            );
            assert!(
                measured.abs_diff_eq(slope, 1e-4),
                "{unknown}: {measured} is not {slope}"
            );
        }
    }

    #[test]
    fn slopes_of_a_pose_match_small_steps() {
        let point = Vec3::new(0.4, -0.2, 1.5);
        for (unknown, slope) in PARALLAX.slopes_of_pose(point).into_iter().enumerate() {
            let axis = Vec3::AXES[unknown % 3];
            let moved = |by: f32| {
                if unknown < 3 {
                    point + by * axis.cross(point)
                } else {
                    point + by * axis
                }
            };
            let measured = (PARALLAX.project(moved(1e-2)) - PARALLAX.project(moved(-1e-2))) / 2e-2;
            assert!(
                measured.abs_diff_eq(slope, 1e-3),
                "{unknown}: {measured} is not {slope}"
            );
        }
    }

    #[test]
    fn expected_error_is_the_motion_of_corners() {
        let camera = Camera::pinhole(640, 480, [600.0, 600.0], [320.0, 240.0]);
        let shift =
            |by: f64| Matrix::from_diagonal(&Vector::from([0.0, 0.0, by * by, 0.0, 0.0, 0.0]));
        let off = PARALLAX.uncertainty(&shift(0.02), &camera, 2.0);
        let moved = Parallax {
            shift: PARALLAX.shift + Vec2::new(0.02, 0.0),
            ..PARALLAX
        };
        assert!(
            (off - PARALLAX.apart(&moved, &camera, 2.0)).abs() < 1e-6,
            "{off}"
        );
        let zoom = Matrix::from_diagonal(&Vector::from([1e-6, 0.0, 0.0, 0.0, 0.0, 0.0]));
        let (off, moved) = (
            PARALLAX.uncertainty(&zoom, &camera, 2.0),
            Parallax {
                zoom: PARALLAX.zoom + 1e-3,
                ..PARALLAX
            },
        );
        assert!(
            (off / PARALLAX.apart(&moved, &camera, 2.0) - 1.0).abs() < 0.01,
            "{off}"
        );
    }
}

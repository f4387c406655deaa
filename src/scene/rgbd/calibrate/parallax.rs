use glam::{DQuat, DVec2, DVec3, Mat2, Vec2, Vec3};

use crate::frames::DepthCamera;
use crate::geometry::{Camera, Pose};

/// Unknowns of a [`Parallax`].
pub const UNKNOWNS: usize = 6;

/// How pictures lie beside the depths that they are taken to lie on: by another focal length, a turn about the axis, another
/// principal point, and a camera that stands aside.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Parallax {
    /// Logarithm of the picture's focal length over the depth's.
    pub zoom: f32,
    /// Turn about the optical axis, radians.
    pub roll: f32,
    /// Shift of the principal point, on the plane at depth 1.
    pub shift: Vec2,
    /// Where the depth's camera stands in the picture's, world units: across the optical axis.
    pub aside: Vec2,
}

impl Parallax {
    /// From its unknowns, in the order of the fields.
    #[must_use]
    pub fn of([zoom, roll, shift_x, shift_y, aside_x, aside_y]: [f32; UNKNOWNS]) -> Self {
        Self { zoom, roll, shift: Vec2::new(shift_x, shift_y), aside: Vec2::new(aside_x, aside_y) }
    }

    /// Where the picture sees a point in the depth camera's axes, on the plane at depth 1 of the camera that was taken to be
    /// the picture's.
    #[must_use]
    pub fn project(&self, point: Vec3) -> Vec2 {
        let beside = Mat2::from_angle(self.roll) * point.truncate() + self.aside;
        self.zoom.exp() * beside / point.z + self.shift
    }

    /// How the place where the picture sees a point moves by the unknowns.
    #[must_use]
    pub fn slopes(&self, point: Vec3) -> [Vec2; UNKNOWNS] {
        let larger = self.zoom.exp() / point.z;
        let turned = Mat2::from_angle(self.roll) * point.truncate();
        [larger * (turned + self.aside), larger * turned.perp(), Vec2::X, Vec2::Y, larger * Vec2::X, larger * Vec2::Y]
    }

    /// The camera of pictures that were taken to have the intrinsics `given`, which are the depth's, and the depth's to it.
    #[must_use]
    pub fn cameras(&self, given: &Camera) -> (Camera, DepthCamera) {
        let larger = f64::from(self.zoom).exp();
        let picture = Camera {
            focal_px: given.focal_px * larger,
            principal_px: given.principal_px + self.shift.as_dvec2() * given.focal_px,
            ..*given
        };
        let picture_from_depth = Pose {
            rotation: DQuat::from_rotation_z(self.roll.into()),
            translation: DVec3::from((self.aside.as_dvec2(), 0.0)),
        };
        (picture, DepthCamera { intrinsics: *given, picture_from_depth, estimated: true })
    }

    /// The farthest that pictures of one and the other lie apart, as a share of the picture's width; things at depth
    /// `typical`.
    #[must_use]
    pub fn apart(&self, other: &Self, camera: &Camera, typical: f32) -> f64 {
        let (width, height) = (f64::from(camera.width), f64::from(camera.height));
        let off = |at_px: DVec2| {
            let point = camera.unproject(at_px).as_vec2().extend(1.0) * typical;
            let apart = self.project(point) - other.project(point);
            (apart.as_dvec2() * camera.focal_px).length() / width
        };
        let corners = [[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]];
        corners.map(|corner| off(DVec2::from(corner))).into_iter().fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PARALLAX: Parallax =
        Parallax { zoom: -0.1, roll: 0.01, shift: Vec2::new(0.002, -0.005), aside: Vec2::new(-0.026, 0.001) };

    #[test]
    fn the_cameras_see_what_it_says() {
        let given = Camera::pinhole(640, 480, 585.0, 580.0, 320.0, 240.0);
        let (picture, depth) = PARALLAX.cameras(&given);
        for point in [Vec3::new(0.4, -0.2, 1.5), Vec3::new(-0.5, 0.7, 3.0)] {
            let seen = picture.project(depth.picture_from_depth.transform(point.as_dvec3())).unwrap();
            let said = given.focal_px * PARALLAX.project(point).as_dvec2() + given.principal_px;
            assert!(seen.abs_diff_eq(said, 1e-3), "{seen} is not {said}");
        }
    }

    #[test]
    fn slopes_are_those_of_small_steps() {
        let point = Vec3::new(0.4, -0.2, 1.5);
        let Parallax { zoom, roll, shift, aside } = PARALLAX;
        for unknown in 0..UNKNOWNS {
            let by = |step: f32| {
                let mut unknowns = [zoom, roll, shift.x, shift.y, aside.x, aside.y];
                unknowns[unknown] += step;
                Parallax::of(unknowns).project(point)
            };
            let (measured, slope) = ((by(1e-2) - by(-1e-2)) / 2e-2, PARALLAX.slopes(point)[unknown]);
            assert!(measured.abs_diff_eq(slope, 1e-4), "{unknown}: {measured} is not {slope}");
        }
    }
}

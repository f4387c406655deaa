use glam::{Mat3, Mat4, Quat, Vec2, Vec3};

use super::{Axes, Bounds, Projection, Side, ViewCamera};
use ostra_geometry::{Camera, Pose};

/// A camera that orbits a target point, controlled by the mouse.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Orbit {
    /// The point that the camera orbits, in world space.
    pub target: Vec3,
    /// Distance from the target, above 0.
    pub distance: f32,
    /// Rotation `camera_from_world` (OpenCV axes).
    pub rotation: Quat,
    /// Axis of horizontal rotation: a unit vector in world space.
    pub up: Vec3,
    /// Vertical field of view in radians.
    pub fov_y: f32,
    /// Whether the projection is orthographic; at the target, sizes are the same as in perspective.
    pub orthographic: bool,
}

impl Orbit {
    /// Creates a view along `direction` that shows all of `bounds`, with `up` pointing upwards.
    #[must_use]
    pub fn framing(bounds: &Bounds, direction: Vec3, up: Vec3) -> Self {
        let fov_y = 40.0_f32.to_radians();
        let rotation = look_rotation(direction, up);
        Self {
            target: bounds.centre(),
            distance: bounds.radius() / (fov_y / 2.0).sin(),
            rotation,
            up: up.normalize_or(Vec3::NEG_Y),
            fov_y,
            orthographic: false,
        }
    }

    /// Creates the view of a frame's camera; the target is at `depth` in front of it.
    #[must_use]
    pub fn through(camera: &Camera, camera_from_world: &Pose, depth: f32, up: Vec3) -> Self {
        let rotation = camera_from_world.rotation.as_quat();
        let forward = rotation.conjugate() * Vec3::Z;
        let fov_y = 2.0 * (f64::from(camera.height) / (2.0 * camera.focal_px.y)).atan() as f32;
        let target = camera_from_world.centre().as_vec3() + forward * depth;
        Self {
            target,
            distance: depth,
            rotation,
            up,
            fov_y,
            orthographic: false,
        }
    }

    /// Rotates the camera by a pointer movement in pixels.
    pub fn orbit(&mut self, delta_px: Vec2) {
        let yaw = Quat::from_axis_angle(self.up, -delta_px.x * 0.008);
        let pitch = Quat::from_rotation_x(-delta_px.y * 0.008);
        let turned = (pitch * self.rotation * yaw).normalize();
        // Left and right are undefined when looking straight along `up`, so the rotation stops a
        // little earlier. A camera that is already steeper may only rotate back. Only a camera that
        // is already upside down may stay so.
        let steep = |rotation: Quat| (rotation.conjugate() * Vec3::Z).dot(self.up).abs();
        let upright = |rotation: Quat| (rotation.conjugate() * Vec3::NEG_Y).dot(self.up);
        let is_free = steep(turned) < 0.998 || steep(turned) < steep(self.rotation);
        if is_free && (upright(turned) > 0.0 || upright(self.rotation) < -1e-3) {
            self.rotation = turned;
        } else {
            self.rotation = (self.rotation * yaw).normalize();
        }
    }

    /// Rotates about `up` by an angle in radians; the scene appears to turn to the right.
    pub fn turn(&mut self, angle: f32) {
        self.rotation = (self.rotation * Quat::from_axis_angle(self.up, -angle)).normalize();
    }

    /// Rotates the camera to a side of the scene; the target stays the same.
    pub fn look_from(&mut self, axes: &Axes, side: Side) {
        let (direction, up_in_image) = axes.look_from(side);
        self.rotation = look_rotation(direction, up_in_image);
        self.up = axes.up;
    }

    /// Pans by a pointer movement in pixels; the target stays under the pointer.
    ///
    /// `height_px` is the height of the view.
    pub fn pan(&mut self, delta_px: Vec2, height_px: f32) {
        let per_px = 2.0 * self.distance * (self.fov_y / 2.0).tan() / height_px.max(1.0);
        self.target -= self.rotation.conjugate() * Vec3::new(delta_px.x, delta_px.y, 0.0) * per_px;
    }

    /// Zooms in (`factor` < 1) or out; the world point `towards` keeps its position in the image.
    pub fn zoom(&mut self, factor: f32, towards: Vec3) {
        let distance = (self.distance * factor).clamp(1e-5, 1e7);
        let factor = distance / self.distance;
        self.target = towards + (self.target - towards) * factor;
        self.distance = distance;
    }

    /// Scales the view with a scene whose lengths were multiplied by a factor above 0.
    ///
    /// The image stays the same.
    pub fn scale_by(&mut self, factor: f32) {
        self.target *= factor;
        self.distance *= factor;
    }

    /// Sets the target and moves it to the centre of the image.
    pub fn recentre(&mut self, target: Vec3) {
        self.target = target;
    }

    /// Returns the camera for an image of this size.
    #[must_use]
    pub fn camera(&self, width: u32, height: u32) -> ViewCamera {
        let eye = self.target - self.rotation.conjugate() * Vec3::Z * self.distance;
        let rotation = Mat3::from_quat(self.rotation);
        let translation = -(rotation * eye);
        let camera_from_world = Mat4::from_cols(
            rotation.x_axis.extend(0.0),
            rotation.y_axis.extend(0.0),
            rotation.z_axis.extend(0.0),
            translation.extend(1.0),
        );
        let focal_px = height.max(1) as f32 / (2.0 * (self.fov_y / 2.0).tan());
        let (projection, near) = if self.orthographic {
            (
                Projection::Orthographic {
                    depth: self.distance,
                },
                self.distance * (1.0 - ViewCamera::REACH),
            )
        } else {
            (Projection::Perspective, self.distance * 1e-3)
        };
        ViewCamera {
            camera_from_world,
            focal_px,
            projection,
            width,
            height,
            near,
        }
    }
}

/// Returns `camera_from_world` for a view along `direction` with `up` upwards in the image.
fn look_rotation(direction: Vec3, up: Vec3) -> Quat {
    let z = direction.normalize_or(Vec3::Z);
    let x = z
        .cross(up)
        .try_normalize()
        .unwrap_or_else(|| z.any_orthonormal_vector());
    let y = z.cross(x);
    Quat::from_mat3(&Mat3::from_cols(x, y, z).transpose())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> Orbit {
        let bounds = Bounds {
            min: Vec3::splat(-1.0),
            max: Vec3::splat(1.0),
        };
        Orbit::framing(&bounds, Vec3::new(0.3, 0.2, 1.0), Vec3::NEG_Y)
    }

    #[test]
    fn framing_shows_the_whole_box_upright() {
        let camera = sample().camera(400, 400);
        for corner in 0..8 {
            let x = Vec3::new(
                f32::from(corner & 1 != 0),
                f32::from(corner & 2 != 0),
                f32::from(corner & 4 != 0),
            ) * 2.0
                - 1.0;
            let (px, _) = camera.project(x).unwrap();
            assert!(px.min_element() > 0.0 && px.max_element() < 400.0, "{px}");
        }
        let top = camera.project(Vec3::NEG_Y).unwrap().0;
        assert!(top.y < 200.0, "up is up: {top}");
    }

    #[test]
    fn zoom_keeps_the_point_under_the_pointer() {
        let mut orbit = sample();
        let towards = Vec3::new(0.5, -0.2, 0.1);
        let before = orbit.camera(640, 480).project(towards).unwrap().0;
        orbit.zoom(0.7, towards);
        let after = orbit.camera(640, 480).project(towards).unwrap().0;
        assert!((before - after).length() < 0.05, "{before} {after}");
    }

    #[test]
    fn orbiting_never_turns_upside_down() {
        let mut orbit = sample();
        for _ in 0..100 {
            orbit.orbit(Vec2::new(3.0, 40.0));
        }
        assert!((orbit.rotation.conjugate() * Vec3::NEG_Y).dot(orbit.up) > 0.0);
    }

    #[test]
    fn side_views_are_upright_and_the_top_view_never_tilts_upside_down() {
        let axes = Axes::new(Vec3::NEG_Y, Vec3::Z);
        let mut orbit = sample();
        let at = |orbit: &Orbit, x: Vec3| orbit.camera(400, 400).project(x).unwrap().0 - 200.0;
        for (side, right) in [
            (Side::Front, Vec3::X),
            (Side::Back, Vec3::NEG_X),
            (Side::Left, Vec3::NEG_Z),
            (Side::Right, Vec3::Z),
        ] {
            orbit.look_from(&axes, side);
            assert!(
                at(&orbit, axes.up).y < -50.0 && at(&orbit, right).x > 50.0,
                "{side:?}"
            );
        }
        orbit.look_from(&axes, Side::Top);
        assert!(at(&orbit, axes.forward).y < -50.0 && at(&orbit, axes.right).x > 50.0);
        for pull in [30.0, -30.0] {
            let mut asift = orbit;
            asift.orbit(Vec2::new(0.0, pull));
            assert!(
                (asift.rotation.conjugate() * Vec3::NEG_Y).dot(orbit.up) > -1e-3,
                "{pull}"
            );
        }
    }

    #[test]
    fn full_turn_returns_to_the_start() {
        let begin = sample();
        let mut orbit = begin;
        for _ in 0..8 {
            orbit.turn(std::f32::consts::TAU / 8.0);
            let steep = |orbit: &Orbit| (orbit.rotation.conjugate() * Vec3::Z).dot(orbit.up);
            assert!((steep(&orbit) - steep(&begin)).abs() < 1e-4);
        }
        assert!(orbit.rotation.angle_between(begin.rotation) < 1e-3);
    }
}

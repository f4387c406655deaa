use glam::{Mat3, Mat4, Quat, Vec2, Vec3, Vec4};

use super::Bounds;
use crate::geometry::{Camera, Pose};

/// A camera that circles around a point, as the mouse moves it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Orbit {
    /// The point circled around, in world space.
    pub target: Vec3,
    /// Distance from the target, above 0.
    pub distance: f32,
    /// Rotation `camera_from_world` (OpenCV axes).
    pub rotation: Quat,
    /// What turns left and right turn about: a unit vector in world space.
    pub up: Vec3,
    /// Vertical field of view in radians.
    pub fov_y: f32,
}

/// A pinhole camera ready to draw with: OpenCV axes, pixel centre of the top-left pixel at (0.5, 0.5).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewCamera {
    /// `camera_from_world`.
    pub camera_from_world: Mat4,
    /// Focal length in pixels.
    pub focal_px: f32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Points nearer than this are not drawn.
    pub near: f32,
}

impl Orbit {
    /// Looks along `direction` at all of `bounds`, `up` upwards.
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
        }
    }

    /// The view of a frame's camera; the target lies at `depth` before it.
    #[must_use]
    pub fn through(camera: &Camera, camera_from_world: &Pose, depth: f32, up: Vec3) -> Self {
        let rotation = camera_from_world.rotation.as_quat();
        let forward = rotation.conjugate() * Vec3::Z;
        let fov_y = 2.0 * (f64::from(camera.height) / (2.0 * camera.focal_px.y)).atan() as f32;
        Self { target: camera_from_world.centre().as_vec3() + forward * depth, distance: depth, rotation, up, fov_y }
    }

    /// Turns by a pointer movement in pixels.
    pub fn orbit(&mut self, delta_px: Vec2) {
        let yaw = Quat::from_axis_angle(self.up, -delta_px.x * 0.008);
        let pitch = Quat::from_rotation_x(-delta_px.y * 0.008);
        let turned = (pitch * self.rotation * yaw).normalize();
        // Looking straight up or down along `up` would make left and right meaningless: stop a little before.
        let before = (self.rotation.conjugate() * Vec3::Z).dot(self.up).abs();
        let after = (turned.conjugate() * Vec3::Z).dot(self.up).abs();
        let upright = (turned.conjugate() * Vec3::NEG_Y).dot(self.up) > 0.0;
        if (after < 0.998 && upright) || after < before {
            self.rotation = turned;
        } else {
            self.rotation = (self.rotation * yaw).normalize();
        }
    }

    /// Moves sideways by a pointer movement in pixels of a view `height_px` high: the target stays under the pointer.
    pub fn pan(&mut self, delta_px: Vec2, height_px: f32) {
        let per_px = 2.0 * self.distance * (self.fov_y / 2.0).tan() / height_px.max(1.0);
        self.target -= self.rotation.conjugate() * Vec3::new(delta_px.x, delta_px.y, 0.0) * per_px;
    }

    /// Comes nearer (`factor` < 1) or goes away, keeping the world point `towards` where it is in the picture.
    pub fn zoom(&mut self, factor: f32, towards: Vec3) {
        let distance = (self.distance * factor).clamp(1e-5, 1e7);
        let factor = distance / self.distance;
        self.target = towards + (self.target - towards) * factor;
        self.distance = distance;
    }

    /// Circles around another point from now on, which moves to the middle of the picture.
    pub fn recentre(&mut self, target: Vec3) {
        self.target = target;
    }

    /// The camera for a picture of this size.
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
        ViewCamera { camera_from_world, focal_px, width, height, near: self.distance * 1e-3 }
    }
}

impl ViewCamera {
    /// Pixel position and depth of a world point; `None` nearer than `near`.
    #[must_use]
    pub fn project(&self, x_in_world: Vec3) -> Option<(Vec2, f32)> {
        let x = self.camera_from_world.transform_point3(x_in_world);
        if x.z < self.near {
            return None;
        }
        let centre = Vec2::new(self.width as f32, self.height as f32) / 2.0;
        Some((x.truncate() / x.z * self.focal_px + centre, x.z))
    }

    /// Where the camera is, in world space.
    #[must_use]
    pub fn place(&self) -> Vec3 {
        self.camera_from_world.inverse().w_axis.truncate()
    }

    /// The world point at a pixel position and depth.
    #[must_use]
    pub fn unproject(&self, at_px: Vec2, depth: f32) -> Vec3 {
        let centre = Vec2::new(self.width as f32, self.height as f32) / 2.0;
        let x = ((at_px - centre) / self.focal_px * depth).extend(depth);
        self.camera_from_world.inverse().transform_point3(x)
    }

    /// `clip_from_world` for wgpu: reversed depth (near → 1, infinity → 0), so that far scenes keep their precision.
    #[must_use]
    pub fn clip_from_world(&self) -> Mat4 {
        let (w, h) = (self.width.max(1) as f32, self.height.max(1) as f32);
        let clip_from_camera = Mat4::from_cols(
            Vec4::new(2.0 * self.focal_px / w, 0.0, 0.0, 0.0),
            Vec4::new(0.0, -2.0 * self.focal_px / h, 0.0, 0.0),
            Vec4::new(0.0, 0.0, 0.0, 1.0),
            Vec4::new(0.0, 0.0, self.near, 0.0),
        );
        clip_from_camera * self.camera_from_world
    }
}

/// The rotation `camera_from_world` that looks along `direction` with `up` upwards in the picture.
fn look_rotation(direction: Vec3, up: Vec3) -> Quat {
    let z = direction.normalize_or(Vec3::Z);
    let x = z.cross(up).try_normalize().unwrap_or_else(|| z.any_orthonormal_vector());
    let y = z.cross(x);
    Quat::from_mat3(&Mat3::from_cols(x, y, z).transpose())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> Orbit {
        let bounds = Bounds { min: Vec3::splat(-1.0), max: Vec3::splat(1.0) };
        Orbit::framing(&bounds, Vec3::new(0.3, 0.2, 1.0), Vec3::NEG_Y)
    }

    #[test]
    fn framing_shows_the_whole_box_upright() {
        let camera = sample().camera(400, 400);
        for corner in 0..8 {
            let x = Vec3::new(f32::from(corner & 1 != 0), f32::from(corner & 2 != 0), f32::from(corner & 4 != 0)) * 2.0
                - 1.0;
            let (px, _) = camera.project(x).unwrap();
            assert!(px.min_element() > 0.0 && px.max_element() < 400.0, "{px}");
        }
        let top = camera.project(Vec3::NEG_Y).unwrap().0;
        assert!(top.y < 200.0, "up is up: {top}");
    }

    #[test]
    fn project_inverts_unproject() {
        let camera = sample().camera(640, 480);
        let x = camera.unproject(Vec2::new(100.0, 300.0), 2.0);
        let (px, depth) = camera.project(x).unwrap();
        assert!((px - Vec2::new(100.0, 300.0)).length() < 1e-2 && (depth - 2.0).abs() < 1e-4);
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
    fn clip_agrees_with_project() {
        let camera = sample().camera(640, 480);
        let x = Vec3::new(0.4, 0.3, -0.6);
        let (px, _) = camera.project(x).unwrap();
        let clip = camera.clip_from_world() * x.extend(1.0);
        let ndc = clip.truncate() / clip.w;
        let from_clip = Vec2::new((ndc.x + 1.0) * 320.0, (1.0 - ndc.y) * 240.0);
        assert!((px - from_clip).length() < 1e-2);
        assert!(ndc.z > 0.0 && ndc.z < 1.0);
    }

    #[test]
    fn orbiting_never_turns_upside_down() {
        let mut orbit = sample();
        for _ in 0..100 {
            orbit.orbit(Vec2::new(3.0, 40.0));
        }
        assert!((orbit.rotation.conjugate() * Vec3::NEG_Y).dot(orbit.up) > 0.0);
    }
}

use glam::{DMat3, DVec2, DVec3, Vec3};

use super::source::check_size;
use crate::SceneError;
use ostra_frames::Frame;
use ostra_geometry::{Camera, Distortion};

/// A posed camera made ready to project many points.
#[derive(Debug, Clone, Copy)]
pub(super) struct View {
    pub(super) camera: Camera,
    /// Rotation of `camera_from_world`.
    pub(super) rotation: DMat3,
    /// Translation of `camera_from_world`.
    pub(super) translation: DVec3,
}

/// Where a point falls in a picture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Projection {
    /// Position in pixels.
    pub(super) at_px: DVec2,
    /// Column of the pixel that holds it.
    pub(super) x: u32,
    /// Row of the pixel that holds it.
    pub(super) y: u32,
    /// Depth along the optical axis.
    pub(super) depth: f64,
}

impl View {
    /// The frame's view; `None` when its camera or pose is not known.
    pub(super) fn new(frame: &Frame) -> Result<Option<Self>, SceneError> {
        let Some((camera, pose)) = frame.posed_camera() else {
            return Ok(None);
        };
        check_size(frame, "camera", camera.width, camera.height)?;
        let rotation = DMat3::from_quat(pose.rotation);
        Ok(Some(Self {
            camera: *camera,
            rotation,
            translation: pose.translation,
        }))
    }

    /// The camera's place in the world.
    pub(super) fn centre(&self) -> DVec3 {
        self.rotation.transpose() * -self.translation
    }

    /// Projects a point of the world; `None` behind the camera or outside the picture.
    pub(super) fn project(&self, x_in_world: Vec3) -> Option<Projection> {
        let x_in_camera = self.rotation * x_in_world.as_dvec3() + self.translation;
        let at_px = if matches!(self.camera.distortion, Distortion::None) {
            if x_in_camera.z <= 0.0 {
                return None;
            }
            x_in_camera.truncate() / x_in_camera.z * self.camera.focal_px + self.camera.principal_px
        } else {
            self.camera.project(x_in_camera)?
        };
        let inside = at_px.x >= 0.0
            && at_px.y >= 0.0
            && at_px.x < f64::from(self.camera.width)
            && at_px.y < f64::from(self.camera.height);
        inside.then_some(Projection {
            at_px,
            x: at_px.x as u32,
            y: at_px.y as u32,
            depth: x_in_camera.z,
        })
    }

    /// Whether a ball may show in the picture. For lenses with distortion only what lies behind is excluded.
    pub(super) fn may_see(&self, centre: DVec3, radius: f64) -> bool {
        let c = self.rotation * centre + self.translation;
        if c.z + radius <= 0.0 {
            return false;
        }
        if !matches!(self.camera.distortion, Distortion::None) {
            return true;
        }
        let (focal, principal) = (self.camera.focal_px, self.camera.principal_px);
        let size = DVec2::new(f64::from(self.camera.width), f64::from(self.camera.height));
        // The four sides of the viewing pyramid as planes through the camera, normals inwards.
        let inside = |lateral: f64, focal: f64, towards: f64| {
            (focal * lateral + towards * c.z) / focal.hypot(towards) > -radius
        };
        inside(c.x, focal.x, principal.x)
            && inside(-c.x, focal.x, size.x - principal.x)
            && inside(c.y, focal.y, principal.y)
            && inside(-c.y, focal.y, size.y - principal.y)
    }
}

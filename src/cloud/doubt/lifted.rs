use glam::{DVec2, Vec3};

use ostra_frames::{DepthMap, Frame};
use ostra_geometry::{Camera, Pose};

/// A frame's pixels in 3-D, by its depth.
pub(crate) struct Lifted<'a> {
    camera: &'a Camera,
    world_from_camera: Pose,
    depth: &'a DepthMap,
}

impl<'a> Lifted<'a> {
    /// `None` where the frame has no camera.
    pub(crate) fn new(frame: &'a Frame, depth: &'a DepthMap) -> Option<Self> {
        let (camera, pose) = frame.posed_camera()?;
        Some(Self {
            camera,
            world_from_camera: pose.inverse(),
            depth,
        })
    }

    /// Where a pixel's surface lies in the world; `None` where the depth is not known.
    pub(crate) fn place(&self, at: usize) -> Option<Vec3> {
        let depth = self.depth.depths[at];
        if depth.is_nan() || depth <= 0.0 {
            return None;
        }
        let (x, y) = (at as u32 % self.depth.width, at as u32 / self.depth.width);
        let ray = self
            .camera
            .unproject(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5))
            .extend(1.0);
        Some(
            self.world_from_camera
                .transform(ray * f64::from(depth))
                .as_vec3(),
        )
    }
}

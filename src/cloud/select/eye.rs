use glam::{DMat3, DVec2, DVec3, Vec3};
use serde::{Deserialize, Serialize};

use crate::SceneError;
use ostra_frames::Frame;
use ostra_geometry::{Camera, Pose};

/// Where a cloud is seen from.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Eye {
    /// The camera of the frame of this number.
    Frame(usize),
    /// A camera of its own.
    Free {
        /// Intrinsics.
        camera: Camera,
        /// Its pose.
        camera_from_world: Pose,
    },
}

/// An eye made ready to project many points.
pub(super) struct Sight {
    pub(super) camera: Camera,
    rotation: DMat3,
    translation: DVec3,
}

impl Eye {
    pub(super) fn sight(&self, frames: &[Frame]) -> Result<Sight, SceneError> {
        let (camera, pose) = match self {
            Self::Frame(number) => {
                let refuse = |why: &str| {
                    SceneError::Request(format!("frame {number} {why}; look from another one"))
                };
                let frame = frames.get(*number).ok_or_else(|| refuse("is not there"))?;
                frame
                    .posed_camera()
                    .ok_or_else(|| refuse("has no camera"))?
            }
            Self::Free {
                camera,
                camera_from_world,
            } => (camera, camera_from_world),
        };
        Ok(Sight {
            camera: *camera,
            rotation: DMat3::from_quat(pose.rotation),
            translation: pose.translation,
        })
    }
}

impl Sight {
    /// Pixel position and depth of a point, also beyond the picture; `None` behind the camera.
    pub(super) fn project(&self, x_in_world: Vec3) -> Option<(DVec2, f64)> {
        let x_in_camera = self.rotation * x_in_world.as_dvec3() + self.translation;
        Some((self.camera.project(x_in_camera)?, x_in_camera.z))
    }

    /// What a pixel covers at a depth, world units.
    pub(super) fn footprint(&self, depth: f64) -> f64 {
        depth / self.camera.focal_px.max_element()
    }
}

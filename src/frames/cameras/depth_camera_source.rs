use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::lines::invalid;
use super::{GivenIntrinsics, IntrinsicsSource, pose_files};
use crate::{DepthCamera, FrameError};
use ostra_geometry::{Pose, Turn};

/// The camera that measured the depths of a recording, where it is known and not the pictures'.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DepthCameraSource {
    /// Its intrinsics, for depths as stored; focal lengths and principal point in their pixels.
    pub intrinsics: IntrinsicsSource,
    /// A text of the 4 × 4 matrix that takes points of the depth camera to the pictures', row by row, in world units (metres); `None` = both stand
    /// in one place and look the same way.
    #[serde(default)]
    pub pose: Option<PathBuf>,
}

/// A [`DepthCameraSource`] that was read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GivenDepthCamera {
    intrinsics: GivenIntrinsics,
    picture_from_depth: Pose,
}

impl DepthCameraSource {
    /// What it says.
    ///
    /// # Errors
    /// [`FrameError`] that names the file when it cannot be read or holds no camera matrix, or no pose.
    pub fn read(&self) -> Result<GivenDepthCamera, FrameError> {
        let picture_from_depth = match &self.pose {
            Some(path) => pose_files::read_one(path)?.map_err(|reason| {
                invalid(path, format!("holds no pose ({reason}); check the file"))
            })?,
            None => Pose::IDENTITY,
        };
        Ok(GivenDepthCamera {
            intrinsics: self.intrinsics.read()?,
            picture_from_depth,
        })
    }
}

impl GivenDepthCamera {
    /// The camera of a stored depth of this size, shown after a turn that its picture takes too.
    ///
    /// # Errors
    /// As [`GivenIntrinsics::for_picture`].
    pub fn for_depth(
        &self,
        (width, height): (u32, u32),
        turn: Turn,
    ) -> Result<DepthCamera, String> {
        let intrinsics = self.intrinsics.for_picture(width, height)?.turned(turn);
        let picture_from_depth = self
            .picture_from_depth
            .turned(turn)
            .compose(&turn.inverse().pose());
        Ok(DepthCamera {
            intrinsics,
            picture_from_depth,
            estimated: false,
        })
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec2, DVec3};

    use super::*;

    #[test]
    fn a_turned_recording_sees_the_same() {
        let folder = tempfile::tempdir().unwrap();
        let pose = folder.path().join("pose.txt");
        std::fs::write(&pose, "1 0 0 0.025\n0 1 0 0.003\n0 0 1 -0.01\n0 0 0 1\n").unwrap();
        let intrinsics = IntrinsicsSource::Values([40.0, 41.0, 16.5, 11.0]);
        let given = DepthCameraSource {
            intrinsics,
            pose: Some(pose),
        }
        .read()
        .unwrap();
        let upright = given.for_depth((32, 24), Turn::None).unwrap();
        assert_eq!(
            upright.picture_from_depth.translation,
            DVec3::new(0.025, 0.003, -0.01)
        );
        let at_px = DVec2::new(7.0, 5.0);
        for turn in [Turn::Clockwise, Turn::Half, Turn::Anticlockwise] {
            let turned = given.for_depth((32, 24), turn).unwrap();
            let point = |camera: &DepthCamera, at_px| {
                camera
                    .picture_from_depth
                    .transform(camera.intrinsics.unproject(at_px).extend(1.0) * 2.0)
            };
            let (here, there) = (
                point(&upright, at_px),
                point(&turned, turn.turn_px(at_px, 32, 24)),
            );
            assert!(
                turn.pose().transform(here).distance(there) < 1e-12,
                "{turn:?}"
            );
        }
    }

    #[test]
    fn what_is_no_pose_is_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let by_columns = "1 0 0 0\n0 1 0 0\n0 0 1 0\n0.025 0 0 1\n".to_owned();
        for (name, text) in [
            ("lost.txt", "inf ".repeat(16)),
            ("short.txt", "1 0 0".into()),
            ("columns.txt", by_columns),
        ] {
            let pose = folder.path().join(name);
            std::fs::write(&pose, text).unwrap();
            let intrinsics = IntrinsicsSource::Values([40.0, 41.0, 16.5, 11.0]);
            let refused = DepthCameraSource {
                intrinsics,
                pose: Some(pose),
            }
            .read()
            .unwrap_err();
            assert!(refused.to_string().contains(name), "{refused}");
        }
    }
}

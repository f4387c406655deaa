use glam::DVec3;

use super::lines::{TextFile, pose_from_quaternion};
use super::{CameraKey, GivenCamera};
use crate::FrameError;

/// Maximum difference in seconds of times that match, as in the benchmark's own tools.
pub const TUM_TOLERANCE_S: f64 = 0.02;

/// Reads a camera-to-world trajectory of the TUM RGB-D benchmark.
///
/// Each line has the values `timestamp tx ty tz qx qy qz qw`.
pub fn read(file: &TextFile) -> Result<Vec<GivenCamera>, FrameError> {
    let mut cameras = Vec::new();
    for line in file.content() {
        let [time, tx, ty, tz, qx, qy, qz, qw] = line.array()?;
        let pose = pose_from_quaternion([qx, qy, qz, qw], DVec3::new(tx, ty, tz))
            .map_err(|error| line.fault(&error.to_string()));
        if !time.is_finite() {
            return Err(line.error("the time is not a finite number; remove or repair the line"));
        }
        cameras.push(GivenCamera {
            key: CameraKey::Time(time),
            intrinsics: None,
            camera_from_world: pose.map(|pose| pose.inverse()),
        });
    }
    Ok(cameras)
}

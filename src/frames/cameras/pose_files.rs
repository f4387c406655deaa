use std::path::{Path, PathBuf};

use super::lines::{TextFile, invalid, pose_from_rows};
use super::{CameraKey, GivenCamera};
use crate::FrameError;
use ostra_geometry::Pose;

/// Reads files of one 4×4 camera-to-world matrix each, named like their images.
///
/// 7-Scenes (`frame-000123.pose.txt`) and ScanNet (`pose/123.txt`) have this format. ScanNet writes
/// infinities for frames that were lost, other programs NaN or zeros. A file that cannot be read
/// gives no pose.
pub fn read(files: &[PathBuf]) -> Result<Vec<GivenCamera>, FrameError> {
    let mut cameras = Vec::with_capacity(files.len());
    for path in files {
        let pose = match read_matrix(path) {
            Ok(rows) => pose_of(path, rows)?,
            Err(error) => Err(error.to_string()),
        };
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let name = name.strip_suffix(".txt").unwrap_or(&name);
        let key = CameraKey::Name(name.strip_suffix(".pose").unwrap_or(name).to_owned());
        cameras.push(GivenCamera {
            key,
            intrinsics: None,
            camera_from_world: pose.map(|pose| pose.inverse()),
        });
    }
    Ok(cameras)
}

/// Returns the pose in a file's 4 × 4 matrix, or why the matrix is not a pose.
pub(super) fn read_one(path: &Path) -> Result<Result<Pose, String>, FrameError> {
    pose_of(path, read_matrix(path)?)
}

fn read_matrix(path: &Path) -> Result<[f64; 16], FrameError> {
    TextFile::read(path)?.numbers()
}

fn pose_of(path: &Path, rows: [f64; 16]) -> Result<Result<Pose, String>, FrameError> {
    let in_file = |reason: String| {
        format!(
            "{}: {reason}",
            path.file_name().unwrap_or_default().display()
        )
    };
    let is_pose =
        rows.iter().all(|number| number.is_finite()) && rows.iter().any(|&number| number != 0.0);
    if is_pose
        && (0..4).any(|column| (rows[12 + column] - f64::from(u8::from(column == 3))).abs() > 1e-6)
    {
        return Err(invalid(
            path,
            "the last row of its matrix is not 0 0 0 1; write it row by row",
        ));
    }
    Ok(pose_from_rows(&rows).map_err(|error| in_file(error.to_string())))
}

use super::lines::{TextFile, pose_from_rows};
use super::{CameraKey, GivenCamera};
use crate::FrameError;

/// Reads a `.log` trajectory of Open3D, Redwood or Tanks and Temples.
///
/// Each entry is a line of three numbers, the first of them the frame's number, then four lines of
/// a 4×4 camera-to-world matrix.
pub fn read(file: &TextFile) -> Result<Vec<GivenCamera>, FrameError> {
    let mut cameras = Vec::new();
    let mut lines = file.content();
    while let Some(line) = lines.next() {
        let mut words = line.words();
        let index: u64 = line.parse(words.next())?;
        if words.count() != 2 {
            return Err(
                line.error("three numbers of a frame belong here, then its matrix; check that the file is whole")
            );
        }
        let mut rows = [0.0; 16];
        for row in rows.chunks_exact_mut(4) {
            let next = lines
                .next()
                .ok_or_else(|| line.error("the matrix is cut off; check that the file is whole"))?;
            row.copy_from_slice(&next.array::<4>()?);
        }
        let pose = pose_from_rows(&rows).map_err(|error| line.fault(&error.to_string()));
        let camera_from_world = pose.map(|pose| pose.inverse());
        cameras.push(GivenCamera {
            key: CameraKey::Index(index),
            intrinsics: None,
            camera_from_world,
        });
    }
    Ok(cameras)
}

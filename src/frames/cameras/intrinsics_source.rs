//! Intrinsics given by the user, as numbers or a file, and the depth camera built from them.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use glam::DVec2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::lines::{TextFile, invalid};
use super::{GivenIntrinsics, pose_files};
use crate::{DepthCamera, FrameError};
use ostra_geometry::{Pose, QuarterRotation};

/// Intrinsics for all frames of a recording: numbers, or a file written by a recorder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum IntrinsicsSource {
    /// Focal lengths `fx`, `fy`, principal point `cx`, `cy` in pixels of the stored image.
    ///
    /// The centre of the top-left pixel is at (0.5, 0.5).
    Values([f64; 4]),
    /// Open3D's `intrinsic.json`, or a text file with a 3 × 3 or 4 × 4 camera matrix.
    ///
    /// Azure Kinect and RealSense recorders write the former, too; ScanNet writes the latter
    /// (`intrinsic_color.txt`). In both, the centre of the top-left pixel is at (0, 0).
    File(PathBuf),
}

impl IntrinsicsSource {
    /// Returns the intrinsics.
    ///
    /// # Errors
    /// [`FrameError`] that names the file if it cannot be read or has no camera matrix.
    pub fn read(&self) -> Result<GivenIntrinsics, FrameError> {
        match self {
            Self::Values(values) => Ok((*values).into()),
            Self::File(path) if path.extension().is_some_and(|ending| ending == "json") => {
                read_json(path)
            }
            Self::File(path) => read_matrix(path),
        }
    }
}

impl From<[f64; 4]> for GivenIntrinsics {
    fn from([fx, fy, cx, cy]: [f64; 4]) -> Self {
        Self::pinhole(DVec2::new(fx, fy), DVec2::new(cx, cy))
    }
}

impl FromStr for IntrinsicsSource {
    type Err = String;

    /// Parses `FX,FY,CX,CY` with positive focal lengths.
    ///
    /// Anything that is not a list of numbers is a path.
    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Result<Vec<f64>, _> = text
            .split(',')
            .map(|part| part.trim().parse::<f64>())
            .collect();
        let Ok(numbers) = numbers else {
            let lists = text.contains(',') && !Path::new(text.trim()).exists();
            let wrong = || {
                "intrinsics are four numbers, FX,FY,CX,CY, or a file that holds a camera matrix"
                    .into()
            };
            return if lists {
                Err(wrong())
            } else {
                Ok(Self::File(text.trim().into()))
            };
        };
        match <[f64; 4]>::try_from(numbers) {
            Ok(values) if values[0] > 0.0 && values[1] > 0.0 => Ok(Self::Values(values)),
            Ok(_) => Err("focal lengths must be above 0".into()),
            Err(numbers) => Err(format!(
                "intrinsics are four numbers, FX,FY,CX,CY, not {}",
                numbers.len()
            )),
        }
    }
}

/// Intrinsics as Open3D writes them, with the matrix column by column.
#[derive(Deserialize)]
struct Open3d {
    width: u32,
    height: u32,
    intrinsic_matrix: [f64; 9],
}

fn read_json(path: &Path) -> Result<GivenIntrinsics, FrameError> {
    let read: Open3d = serde_json::from_str(&TextFile::read(path)?.text).map_err(|error| {
        invalid(
            path,
            format!("holds no width, height and intrinsic_matrix as Open3D's do ({error})"),
        )
    })?;
    let m = read.intrinsic_matrix;
    Ok(GivenIntrinsics {
        size: Some([read.width, read.height]),
        ..from_matrix(path, [m[0], m[4], m[6], m[7]], m[8])?
    })
}

fn read_matrix(path: &Path) -> Result<GivenIntrinsics, FrameError> {
    let file = TextFile::read(path)?;
    let (values, last) = match file.numbers::<9>() {
        Ok(m) => ([m[0], m[4], m[2], m[5]], m[8]),
        Err(_) => {
            let m: [f64; 16] = file.numbers().map_err(|_| {
                invalid(
                    path,
                    "holds no camera matrix of 3 × 3 or 4 × 4 numbers; check the file",
                )
            })?;
            ([m[0], m[5], m[2], m[6]], m[10])
        }
    };
    from_matrix(path, values, last)
}

/// Returns the intrinsics of a camera matrix from its entries; the last one must be 1.
fn from_matrix(
    path: &Path,
    [fx, fy, cx, cy]: [f64; 4],
    last: f64,
) -> Result<GivenIntrinsics, FrameError> {
    if (last - 1.0).abs() > 1e-9 || !(fx > 0.0 && fy > 0.0 && cx > 0.0 && cy > 0.0) {
        return Err(invalid(
            path,
            "holds numbers that are not a camera matrix (fx, fy, cx, cy above 0); check the file",
        ));
    }
    Ok([fx, fy, cx + 0.5, cy + 0.5].into())
}

/// The camera that measured the depth of a recording, if it is known and not that of the images.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct DepthCameraSource {
    /// Intrinsics for depth as stored; focal lengths and principal point in its pixels.
    pub intrinsics: IntrinsicsSource,
    /// Text file with the 4 × 4 matrix from the depth camera's axes to those of the images' camera.
    ///
    /// It is stored row by row, in world units (metres). `None` = both cameras have the same pose.
    #[serde(default)]
    pub pose: Option<PathBuf>,
}

/// A [`DepthCameraSource`] after reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GivenDepthCamera {
    intrinsics: GivenIntrinsics,
    image_from_depth: Pose,
}

impl DepthCameraSource {
    /// Returns the depth camera.
    ///
    /// # Errors
    /// [`FrameError`] that names the file if it cannot be read or has no camera matrix or pose.
    pub fn read(&self) -> Result<GivenDepthCamera, FrameError> {
        let image_from_depth = match &self.pose {
            Some(path) => pose_files::read_one(path)?.map_err(|reason| {
                invalid(path, format!("holds no pose ({reason}); check the file"))
            })?,
            None => Pose::IDENTITY,
        };
        Ok(GivenDepthCamera {
            intrinsics: self.intrinsics.read()?,
            image_from_depth,
        })
    }
}

impl GivenDepthCamera {
    /// Returns the camera of a stored depth map of this size, after the rotation of its image.
    ///
    /// # Errors
    ///
    /// As [`GivenIntrinsics::for_image`].
    pub fn for_depth(
        &self,
        width: u32,
        height: u32,
        turn: QuarterRotation,
    ) -> Result<DepthCamera, String> {
        let intrinsics = self.intrinsics.for_image(width, height)?.turned(turn);
        let image_from_depth = self
            .image_from_depth
            .turned(turn)
            .compose(&turn.inverse().pose());
        Ok(DepthCamera {
            intrinsics,
            image_from_depth,
            estimated: false,
        })
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec2, DVec3};

    use super::*;

    #[test]
    fn numbers_and_files_are_distinguished() {
        let source = |text: &str| text.parse::<IntrinsicsSource>();
        assert_eq!(
            source("500, 501.5,320,240"),
            Ok(IntrinsicsSource::Values([500.0, 501.5, 320.0, 240.0]))
        );
        assert_eq!(
            source("camera/intrinsic.json"),
            Ok(IntrinsicsSource::File("camera/intrinsic.json".into()))
        );
        for wrong in ["500,501,320", "0,1,2,3", "500,x,320,240", "500"] {
            assert!(source(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn files_have_their_origin_at_the_first_pixels_centre() {
        let folder = tempfile::tempdir().unwrap();
        let read = |name: &str, text: &str| {
            let path = folder.path().join(name);
            std::fs::write(&path, text).unwrap();
            IntrinsicsSource::File(path)
                .read()
                .map_err(|error| error.to_string())
        };
        let expected: GivenIntrinsics = [525.0, 526.0, 320.0, 240.0].into();
        let open3d = r#"{"width": 640, "height": 480, "intrinsic_matrix": [525, 0, 0, 0, 526, 0, 319.5, 239.5, 1]}"#;
        let json = read("intrinsic.json", open3d).unwrap();
        assert_eq!(
            json,
            GivenIntrinsics {
                size: Some([640, 480]),
                ..expected
            }
        );
        assert!(json.for_image(320, 240).unwrap_err().contains("640x480"));
        let three = "525 0 319.5\n0 526 239.5\n0 0 1\n";
        let four = "525 0 319.5 0\n0 526 239.5 0\n0 0 1 0\n0 0 0 1\n";
        assert_eq!(
            (read("k.txt", three), read("intrinsic_color.txt", four)),
            (Ok(expected), Ok(expected))
        );
        assert!(
            read("pose.txt", "1 0 0 0\n0 1 0 0\n0 0 1 2\n0 0 0 1\n")
                .unwrap_err()
                .contains("pose.txt")
        );
        assert!(read("other.json", "{}").unwrap_err().contains("other.json"));
    }

    #[test]
    fn rotated_recording_sees_the_same() {
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
        let upright = given.for_depth(32, 24, QuarterRotation::None).unwrap();
        assert_eq!(
            upright.image_from_depth.translation,
            DVec3::new(0.025, 0.003, -0.01)
        );
        let at_px = DVec2::new(7.0, 5.0);
        for turn in [
            QuarterRotation::Clockwise,
            QuarterRotation::Half,
            QuarterRotation::Anticlockwise,
        ] {
            let turned = given.for_depth(32, 24, turn).unwrap();
            let point = |camera: &DepthCamera, at_px| {
                camera
                    .image_from_depth
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
    fn invalid_pose_file_is_refused_by_name() {
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

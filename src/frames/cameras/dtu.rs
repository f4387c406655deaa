use std::path::{Path, PathBuf};

use glam::{DMat3, DVec2, DVec3};

use super::lines::TextFile;
use super::{CameraKey, GivenCamera, GivenIntrinsics};
use crate::FrameError;
use ostra_geometry::Pose;

/// Maximum ratio of skew to focal length of a camera that counts as having no skew.
pub const LARGEST_SKEW: f64 = 2e-3;

/// Returns the number of a file `pos_NNN.txt`.
pub fn number_of(path: &Path) -> Option<u64> {
    path.file_name()?
        .to_str()?
        .strip_prefix("pos_")?
        .strip_suffix(".txt")?
        .parse()
        .ok()
}

/// Reads the projection matrices of the DTU sets.
///
/// Each file `pos_NNN.txt`, with NNN from 1, has one 3×4 matrix; pixel centres are at whole
/// numbers.
pub fn read(files: &[PathBuf]) -> Result<Vec<GivenCamera>, FrameError> {
    files
        .iter()
        .filter_map(|path| Some((path, number_of(path)?)))
        .map(|(path, number)| read_file(path, number))
        .collect()
}

fn read_file(path: &Path, number: u64) -> Result<GivenCamera, FrameError> {
    let rows: [f64; 12] = TextFile::read(path)?.numbers()?;
    let name = path.file_name().unwrap_or_default().display();
    let (intrinsics, pose) = match decompose(&rows) {
        Ok((intrinsics, pose)) => (Some(intrinsics), Ok(pose)),
        Err(what) => (None, Err(format!("{name}: {what}"))),
    };
    Ok(GivenCamera {
        key: CameraKey::Index(number),
        intrinsics,
        camera_from_world: pose,
    })
}

/// Decomposes `P = K [R t]`, known up to scale, by an RQ decomposition of its left 3×3 part.
///
/// The rows are processed from the last one up.
fn decompose(p: &[f64; 12]) -> Result<(GivenIntrinsics, Pose), String> {
    if p.iter().any(|v| !v.is_finite()) {
        return Err(
            "the matrix has a value that is not a finite number; remove or repair it".into(),
        );
    }
    let row = |i: usize| DVec3::new(p[4 * i], p[4 * i + 1], p[4 * i + 2]);
    let sign = row(0).dot(row(1).cross(row(2))).signum();
    let scale = sign / row(2).length();
    let [m1, m2, m3] = [row(0) * scale, row(1) * scale, row(2) * scale];
    let last = DVec3::new(p[3], p[7], p[11]) * scale;
    let (r3, cy) = (m3, m2.dot(m3));
    let fy = (m2 - cy * r3).length();
    let r2 = (m2 - cy * r3) / fy;
    let (cx, skew) = (m1.dot(r3), m1.dot(r2));
    let fx = (m1 - cx * r3 - skew * r2).length();
    let r1 = (m1 - cx * r3 - skew * r2) / fx;
    if !(fx > 0.0
        && fy > 0.0
        && fx.is_finite()
        && fy.is_finite()
        && r1.is_finite()
        && r2.is_finite())
    {
        return Err("the matrix is not a camera projection; check the file".into());
    }
    if skew.abs() > LARGEST_SKEW * fx {
        return Err("the camera has skew, which is not supported; undistort the images".into());
    }
    let y = (last.y - cy * last.z) / fy;
    let translation = DVec3::new((last.x - cx * last.z - skew * y) / fx, y, last.z);
    let rotation = DMat3::from_cols(r1, r2, r3).transpose();
    let pose = Pose::from_matrix(rotation, translation).map_err(|error| error.to_string())?;
    Ok((
        GivenIntrinsics::pinhole(DVec2::new(fx, fy), DVec2::new(cx + 0.5, cy + 0.5)),
        pose,
    ))
}

use glam::{DMat3, DVec2, DVec3};

use super::lines::{TextFile, TextLine};
use super::{CameraKey, GivenCamera, GivenIntrinsics};
use crate::FrameError;
use ostra_geometry::Pose;

/// Reads a `*_par.txt` of the Middlebury multi-view sets.
///
/// The file has a count, then lines `name k11 … k33 r11 … r33 t1 t2 t3` with `P = K [R t]`; pixel
/// centres are at whole numbers.
pub fn read(file: &TextFile) -> Result<Vec<GivenCamera>, FrameError> {
    let mut lines = file.content();
    let Some(first) = lines.next() else {
        return Ok(Vec::new());
    };
    let count: usize = first.parse(first.words().next())?;
    let cameras = lines
        .map(|line| read_line(line))
        .collect::<Result<Vec<_>, _>>()?;
    if cameras.len() != count {
        let what = format!(
            "{count} cameras are announced, {} follow; check that the file is whole",
            cameras.len()
        );
        return Err(first.error(&what));
    }
    Ok(cameras)
}

fn read_line(line: TextLine<'_>) -> Result<GivenCamera, FrameError> {
    let mut words = line.words();
    let name = words.next().unwrap_or_default();
    let numbers: Vec<f64> = words
        .map(|word| line.parse(Some(word)))
        .collect::<Result<_, _>>()?;
    let values: [f64; 21] = numbers
        .try_into()
        .map_err(|_| line.error("21 numbers belong after the name"))?;
    let (k, r, t) = (
        &values[..9],
        &values[9..18],
        DVec3::from_slice(&values[18..]),
    );
    if k[1].abs() > super::dtu::LARGEST_SKEW * k[0].abs() {
        return Err(line.error("the camera has skew, which is not supported; undistort the images"));
    }
    let pose = Pose::from_matrix(DMat3::from_cols_slice(r).transpose(), t)
        .map_err(|e| line.fault(&e.to_string()));
    let half = DVec2::splat(0.5);
    let intrinsics =
        GivenIntrinsics::pinhole(DVec2::new(k[0], k[4]), DVec2::new(k[2], k[5]) + half);
    Ok(GivenCamera {
        key: CameraKey::Name(name.to_owned()),
        intrinsics: Some(intrinsics),
        camera_from_world: pose,
    })
}

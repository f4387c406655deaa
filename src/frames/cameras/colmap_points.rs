use std::path::Path;

use glam::DVec3;

use super::SparsePoint;
use super::colmap_binary::Cursor;
use super::detect::colmap_folder;
use super::lines::{Line, TextFile, invalid};
use crate::FrameError;

/// The points of the COLMAP model in `path` (its folder, or one with `sparse/` or `sparse/0`), in the file's order;
/// empty where the model has no file of points.
///
/// # Errors
/// [`FrameError::NotFound`] where there is no model; [`FrameError::Invalid`] for damaged files.
pub fn read_sparse_points(path: &Path) -> Result<Vec<SparsePoint>, FrameError> {
    let folder = colmap_folder(path).ok_or_else(|| {
        FrameError::NotFound(format!(
            "{}: holds no COLMAP model (cameras and images, .txt or .bin)",
            path.display()
        ))
    })?;
    let (binary, text) = (folder.join("points3D.bin"), folder.join("points3D.txt"));
    let points = if folder.join("cameras.bin").is_file() && binary.is_file() {
        read_binary(&mut Cursor::open(&binary)?)?
    } else if text.is_file() {
        TextFile::read(&text)?
            .content()
            .map(|line| read_line(line))
            .collect::<Result<Vec<_>, _>>()?
    } else {
        Vec::new()
    };
    if points.iter().all(|point| point.position.is_finite()) {
        Ok(points)
    } else {
        Err(invalid(
            &folder,
            "a 3-D point has a value that is not a finite number; remove or repair it",
        ))
    }
}

fn read_line(line: Line<'_>) -> Result<SparsePoint, FrameError> {
    let mut words = line.words();
    let _id: u64 = line.parse(words.next())?;
    let position = DVec3::new(
        line.parse(words.next())?,
        line.parse(words.next())?,
        line.parse(words.next())?,
    );
    let color = [
        line.parse(words.next())?,
        line.parse(words.next())?,
        line.parse(words.next())?,
    ];
    let error: f64 = line.parse(words.next())?;
    Ok(SparsePoint {
        position,
        color,
        error_px: known(error),
    })
}

/// COLMAP writes −1 for an error that is not known.
fn known(error_px: f64) -> Option<f64> {
    Some(error_px).filter(|&error| error >= 0.0)
}

fn read_binary(file: &mut Cursor<'_>) -> Result<Vec<SparsePoint>, FrameError> {
    let mut points = Vec::new();
    for _ in 0..file.count(51)? {
        let _id = file.u64()?;
        let position = DVec3::new(file.f64()?, file.f64()?, file.f64()?);
        let color = [file.u8()?, file.u8()?, file.u8()?];
        let error_px = known(file.f64()?);
        let track = file.u64()?;
        file.skip_records(track, 8)?;
        points.push(SparsePoint {
            position,
            color,
            error_px,
        });
    }
    Ok(points)
}

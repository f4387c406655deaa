//! Sparse points with the keypoints that see them, read from COLMAP models.

use std::collections::BTreeMap;
use std::path::Path;

use glam::{DVec2, DVec3};

use super::colmap_binary::Cursor;
use super::detect::colmap_folder;
use super::given::{stored_size, turn_of};
use super::lines::{TextFile, TextLine, invalid};
use crate::{Frame, FrameError};

/// A point of a sparse model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SparsePoint {
    /// Position in world units.
    pub position: DVec3,
    /// sRGB colour.
    pub color: [u8; 3],
    /// Mean reprojection error in pixels; `None` = unknown.
    pub error_px: Option<f64>,
}

/// A keypoint of a frame's image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SparseKeypoint {
    /// Position in the image as shown, centre of the top-left pixel at (0.5, 0.5).
    pub at_px: DVec2,
    /// Index of the point that it sees, if any.
    pub point: Option<u32>,
}

/// The points of a sparse model and the keypoints that see them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SparsePoints {
    /// The points.
    pub points: Vec<SparsePoint>,
    /// Keypoints of each image by frame number; empty if unknown.
    pub keypoints: BTreeMap<usize, Vec<SparseKeypoint>>,
}

impl SparsePoints {
    /// Returns points whose keypoints are unknown.
    #[must_use]
    pub fn without_keypoints(points: Vec<SparsePoint>) -> Self {
        Self {
            points,
            keypoints: BTreeMap::new(),
        }
    }

    /// Returns for each point the (frame, keypoint) pairs that see it, in this order.
    #[must_use]
    pub fn tracks(&self) -> Vec<Vec<(usize, u32)>> {
        let mut tracks = vec![Vec::new(); self.points.len()];
        for (&frame, keypoints) in &self.keypoints {
            for (index, keypoint) in keypoints.iter().enumerate() {
                if let Some(track) = keypoint
                    .point
                    .and_then(|point| tracks.get_mut(point as usize))
                {
                    track.push((frame, index as u32));
                }
            }
        }
        tracks
    }
}

/// Reads the points of the COLMAP model in `path`, in the file's order.
///
/// `path` is the model's folder, or one with `sparse/` or `sparse/0`. The result is empty if the
/// model has no file of points.
///
/// # Errors
///
/// [`FrameError::NotFound`] if there is no model; [`FrameError::Invalid`] for damaged files.
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

fn read_line(line: TextLine<'_>) -> Result<SparsePoint, FrameError> {
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

/// Returns the error if it is known; COLMAP writes −1 otherwise.
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

/// Reads the points and keypoints of a text model written by [`super::write_colmap_model`].
///
/// The model must be that of these frames: points are numbered from 1 in order, and images have the
/// frames' names.
///
/// # Errors
///
/// [`FrameError`] if a file is missing or damaged.
pub fn read_sparse_model(folder: &Path, frames: &[Frame]) -> Result<SparsePoints, FrameError> {
    let points = read_sparse_points(folder)?;
    let numbers: BTreeMap<&str, usize> = frames
        .iter()
        .enumerate()
        .map(|(i, frame)| (frame.name.as_str(), i))
        .collect();
    let file = TextFile::read(&folder.join("images.txt"))?;
    let mut keypoints = BTreeMap::new();
    let mut lines = file.lines().filter(|line| !line.text.starts_with('#'));
    while let (Some(image), Some(seen)) = (lines.next(), lines.next()) {
        let name = image.text.splitn(10, ' ').nth(9).unwrap_or_default();
        let Some(&number) = numbers.get(name) else {
            continue;
        };
        keypoints.insert(number, read_keypoints(&frames[number], seen, points.len())?);
    }
    Ok(SparsePoints { points, keypoints })
}

fn read_keypoints(
    frame: &Frame,
    line: TextLine<'_>,
    points: usize,
) -> Result<Vec<SparseKeypoint>, FrameError> {
    let turn = turn_of(frame).map_err(|error| line.error(&error.to_string()))?;
    let stored = stored_size(frame, turn);
    let mut keypoints = Vec::new();
    let mut words = line.words();
    while let Some(x) = words.next() {
        let at_px = DVec2::new(line.parse(Some(x))?, line.parse(words.next())?);
        let id: i64 = line.parse(words.next())?;
        let point = u32::try_from(id - 1)
            .ok()
            .filter(|&point| (point as usize) < points);
        keypoints.push(SparseKeypoint {
            at_px: turn.turn_px(at_px, stored.0, stored.1),
            point,
        });
    }
    Ok(keypoints)
}

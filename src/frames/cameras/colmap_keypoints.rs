use std::collections::BTreeMap;
use std::path::Path;

use glam::DVec2;

use super::attach::{stored_size, turn_of};
use super::lines::{Line, TextFile};
use super::{SparseKeypoint, SparsePoints, read_sparse_points};
use crate::{Frame, FrameError};

/// Reads back the points and keypoints of a text model that [`super::write_colmap_model`] wrote for these frames: points
/// are numbered from 1 in order, images bear the frames' names.
///
/// # Errors
/// [`FrameError`] where a file is missing or damaged.
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
    line: Line<'_>,
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

use std::collections::BTreeMap;
use std::path::Path;

use glam::DVec3;

use super::colmap_model::intrinsics;
use super::lines::{TextFile, TextLine, pose_from_quaternion};
use super::{CameraKey, GivenCamera, GivenIntrinsics};
use crate::FrameError;

/// Reads `cameras.txt` and `images.txt` of a COLMAP text model.
pub fn read(folder: &Path) -> Result<Vec<GivenCamera>, FrameError> {
    let cameras = read_cameras(&TextFile::read(&folder.join("cameras.txt"))?)?;
    read_images(&TextFile::read(&folder.join("images.txt"))?, &cameras)
}

/// Reads the cameras by number. An unusable camera is an error only if an image refers to it.
fn read_cameras(
    file: &TextFile,
) -> Result<BTreeMap<u32, Result<GivenIntrinsics, String>>, FrameError> {
    file.content().map(|line| read_camera(line)).collect()
}

fn read_camera(line: TextLine<'_>) -> Result<(u32, Result<GivenIntrinsics, String>), FrameError> {
    let mut words = line.words();
    let id = line.parse(words.next())?;
    let model: String = line.parse(words.next())?;
    let size = [line.parse(words.next())?, line.parse(words.next())?];
    let parameters: Vec<f64> = words
        .map(|word| line.parse(Some(word)))
        .collect::<Result<_, _>>()?;
    Ok((
        id,
        intrinsics(&model, size, &parameters)
            .map_err(|what| format!("cameras.txt: {}", line.fault(&what))),
    ))
}

/// Reads two lines per image: the second lists its 2-D points and may be empty.
fn read_images(
    file: &TextFile,
    cameras: &BTreeMap<u32, Result<GivenIntrinsics, String>>,
) -> Result<Vec<GivenCamera>, FrameError> {
    let mut images = Vec::new();
    let mut lines = file.lines();
    while let Some(line) = lines.next() {
        if line.is_blank() {
            continue;
        }
        images.push(read_image(line, cameras)?);
        if let Some(points) = lines.next() {
            check_points(points)?;
        }
    }
    Ok(images)
}

fn read_image(
    line: TextLine<'_>,
    cameras: &BTreeMap<u32, Result<GivenIntrinsics, String>>,
) -> Result<GivenCamera, FrameError> {
    let mut words = line.words();
    let _id: u32 = line.parse(words.next())?;
    let mut v = [0.0f64; 7];
    for value in &mut v {
        *value = line.parse(words.next())?;
    }
    let camera: u32 = line.parse(words.next())?;
    let name = name_after(line.text, 9).ok_or_else(|| line.error("an image has no name"))?;
    let pose = pose_from_quaternion([v[1], v[2], v[3], v[0]], DVec3::new(v[4], v[5], v[6]))
        .map_err(|error| line.fault(&format!("{name}: {error}")));
    let given = cameras.get(&camera).ok_or_else(|| {
        line.error(&format!(
            "{name} has camera {camera}, which cameras.txt does not hold"
        ))
    })?;
    Ok(GivenCamera::with_intrinsics(
        CameraKey::Name(name.to_owned()),
        given,
        pose,
    ))
}

/// Returns the rest of a line after `count` words: a name, which may contain spaces.
fn name_after(text: &str, count: usize) -> Option<&str> {
    let mut rest = text;
    for _ in 0..count {
        rest = rest.trim_start();
        rest = &rest[rest.find(char::is_whitespace)?..];
    }
    Some(rest.trim()).filter(|name| !name.is_empty())
}

/// Checks that a line lists 2-D points.
///
/// In a file without these lines, every second image would otherwise be lost silently.
fn check_points(line: TextLine<'_>) -> Result<(), FrameError> {
    let numbers = line.words().count().is_multiple_of(3);
    let begin = line.words().take(3).all(|word| word.parse::<f64>().is_ok());
    if line.text.starts_with('#') || !numbers || !begin {
        return Err(
            line.error("after each image belongs a line with its 2-D points, which may be empty")
        );
    }
    Ok(())
}

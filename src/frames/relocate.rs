use std::path::{Path, PathBuf};

use super::header::read_header;
use super::{DepthSource, Frame, FrameError, ImageSource, Orientation};

/// Returns the missing source files, each once, in the order of the frames.
#[must_use]
pub fn missing_sources(frames: &[Frame]) -> Vec<&Path> {
    let mut missing: Vec<&Path> = Vec::new();
    for path in frames.iter().flat_map(sources) {
        if missing.last() != Some(&path) && !path.exists() {
            missing.push(path);
        }
    }
    missing.dedup();
    missing
}

/// Returns the source files of a frame: its image or video, then the image of its sensor's depth.
pub fn sources(frame: &Frame) -> impl Iterator<Item = &Path> {
    let depth = frame.depth.as_ref().and_then(DepthSource::sensor_path);
    [Some(frame.image.path()), depth].into_iter().flatten()
}

/// Returns the [`sources`] as mutable paths.
pub fn sources_mut(frame: &mut Frame) -> impl Iterator<Item = &mut PathBuf> {
    let depth = frame.depth.as_mut().and_then(DepthSource::sensor_path_mut);
    [Some(frame.image.path_mut()), depth].into_iter().flatten()
}

/// Checks that a file can be the `place`th of a frame's [`sources`]; only its header is read.
///
/// # Errors
///
/// [`FrameError`] if the file is missing or an image of another size than the frame was created
/// from.
pub fn check_source(frame: &Frame, place: usize, path: &Path) -> Result<(), FrameError> {
    if !path.is_file() {
        return Err(FrameError::Missing { path: path.into() });
    }
    let (shown, orientation) = (
        (frame.width, frame.height),
        source_orientation(frame, place),
    );
    let wanted = match &frame.depth {
        Some(DepthSource::Sensor {
            camera: Some(own), ..
        }) if place > 0 => (own.intrinsics.width, own.intrinsics.height),
        _ => shown,
    };
    // The size of a video is only known, and checked, after decoding.
    let Some(orientation) = orientation else {
        return Ok(());
    };
    let header = read_header(path)?;
    let (width, height) = orientation.shown_size(header.width, header.height);
    if (width, height) == wanted {
        return Ok(());
    }
    let what = format!(
        "it has {width} × {height} pixels, frame {} was made of {} × {}; give the file that the frame was made of",
        frame.name, wanted.0, wanted.1
    );
    Err(FrameError::Invalid {
        path: path.into(),
        what,
    })
}

/// Returns the rotation between a stored image and its known size; `None` for a video.
fn source_orientation(frame: &Frame, place: usize) -> Option<Orientation> {
    match (&frame.depth, &frame.image) {
        (
            Some(DepthSource::Sensor {
                camera: Some(_), ..
            }),
            _,
        ) if place > 0 => Some(Orientation::default()),
        (Some(DepthSource::Sensor { orientation, .. }), _) if place > 0 => Some(*orientation),
        (_, ImageSource::File { orientation, .. }) => Some(*orientation),
        (_, ImageSource::Video { .. }) => None,
    }
}

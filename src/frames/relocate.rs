use std::path::{Path, PathBuf};

use super::header::read_header;
use super::{DepthSource, Frame, FrameError, Orientation, PictureSource};

/// The source files that are not where they were, each once, in the order of the frames.
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

/// The files that a frame is read from: its image or video, then the image of its sensor's depth.
pub fn sources(frame: &Frame) -> impl Iterator<Item = &Path> {
    let depth = frame.depth.as_ref().and_then(DepthSource::sensor_path);
    [Some(frame.picture.path()), depth].into_iter().flatten()
}

/// As [`sources`], to point them elsewhere.
pub fn sources_mut(frame: &mut Frame) -> impl Iterator<Item = &mut PathBuf> {
    let depth = frame.depth.as_mut().and_then(DepthSource::sensor_path_mut);
    [Some(frame.picture.path_mut()), depth]
        .into_iter()
        .flatten()
}

/// Refuses a file that cannot be the `place`th of a frame's [`sources`]: one that is missing, or an image of another size
/// than the frame was made of. Only the header is read.
///
/// # Errors
/// [`FrameError`] says what is wrong with the file.
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
    // The size of a video is known once it is decoded; it is checked then.
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

/// The turn between a stored image and the size that is known of it; `None` for a video.
fn source_orientation(frame: &Frame, place: usize) -> Option<Orientation> {
    match (&frame.depth, &frame.picture) {
        (
            Some(DepthSource::Sensor {
                camera: Some(_), ..
            }),
            _,
        ) if place > 0 => Some(Orientation::default()),
        (Some(DepthSource::Sensor { orientation, .. }), _) if place > 0 => Some(*orientation),
        (_, PictureSource::File { orientation, .. }) => Some(*orientation),
        (_, PictureSource::Film { .. }) => None,
    }
}

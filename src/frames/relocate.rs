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

/// Points all sources below `old_root` (a folder or a film) to `new_root`, where they were moved. Returns how many
/// frames changed.
///
/// # Errors
/// [`FrameError::NotFound`] when no frame comes from `old_root` or a file is not at the new place; then nothing changes.
pub fn relocate(frames: &mut [Frame], old_root: &Path, new_root: &Path) -> Result<usize, FrameError> {
    let new_root = new_root.canonicalize().map_err(|source| FrameError::io(new_root, source))?;
    let moved = |path: &Path| path.strip_prefix(old_root).ok().map(|rest| joined(&new_root, rest));
    for path in frames.iter().flat_map(sources) {
        if let Some(new) = moved(path).filter(|new| !new.exists()) {
            return Err(FrameError::NotFound(format!(
                "{}: not there, so {} cannot be replaced by {}; give the folder that holds the same files",
                new.display(),
                old_root.display(),
                new_root.display()
            )));
        }
    }
    let mut count = 0;
    for frame in frames {
        let mut changed = false;
        let depth = frame.depth.as_mut().and_then(DepthSource::sensor_path_mut);
        for path in [Some(frame.picture.path_mut()), depth].into_iter().flatten() {
            if let Some(new) = moved(path) {
                (*path, changed) = (new, true);
            }
        }
        count += usize::from(changed);
    }
    if count == 0 {
        let old_root = old_root.display();
        return Err(FrameError::NotFound(format!("no frame comes from {old_root}; give the folder the project names")));
    }
    Ok(count)
}

/// The files that a frame is read from: its image or video, then the image of its sensor's depth.
pub fn sources(frame: &Frame) -> impl Iterator<Item = &Path> {
    let depth = frame.depth.as_ref().and_then(DepthSource::sensor_path);
    [Some(frame.picture.path()), depth].into_iter().flatten()
}

/// As [`sources`], to point them elsewhere.
pub fn sources_mut(frame: &mut Frame) -> impl Iterator<Item = &mut PathBuf> {
    let depth = frame.depth.as_mut().and_then(DepthSource::sensor_path_mut);
    [Some(frame.picture.path_mut()), depth].into_iter().flatten()
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
    let (shown, orientation) = ((frame.width, frame.height), source_orientation(frame, place));
    let wanted = match &frame.depth {
        Some(DepthSource::Sensor { camera: Some(own), .. }) if place > 0 => {
            (own.intrinsics.width, own.intrinsics.height)
        }
        _ => shown,
    };
    // The size of a video is known once it is decoded; it is checked then.
    let Some(orientation) = orientation else { return Ok(()) };
    let header = read_header(path)?;
    let (width, height) = orientation.shown_size(header.width, header.height);
    if (width, height) == wanted {
        return Ok(());
    }
    let what = format!(
        "it has {width} × {height} pixels, frame {} was made of {} × {}; give the file that the frame was made of",
        frame.name, wanted.0, wanted.1
    );
    Err(FrameError::Invalid { path: path.into(), what })
}

/// The turn between a stored image and the size that is known of it; `None` for a video.
fn source_orientation(frame: &Frame, place: usize) -> Option<Orientation> {
    match (&frame.depth, &frame.picture) {
        (Some(DepthSource::Sensor { camera: Some(_), .. }), _) if place > 0 => Some(Orientation::default()),
        (Some(DepthSource::Sensor { orientation, .. }), _) if place > 0 => Some(*orientation),
        (_, PictureSource::File { orientation, .. }) => Some(*orientation),
        (_, PictureSource::Film { .. }) => None,
    }
}

fn joined(root: &Path, rest: &Path) -> PathBuf {
    if rest.as_os_str().is_empty() { root.into() } else { root.join(rest) }
}

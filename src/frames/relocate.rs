use std::path::{Path, PathBuf};

use super::{DepthSource, Frame, FrameError};

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

fn sources(frame: &Frame) -> impl Iterator<Item = &Path> {
    let depth = frame.depth.as_ref().and_then(DepthSource::sensor_path);
    [Some(frame.picture.path()), depth].into_iter().flatten()
}

fn joined(root: &Path, rest: &Path) -> PathBuf {
    if rest.as_os_str().is_empty() { root.into() } else { root.join(rest) }
}

use std::fs::File;
use std::io::Error;
use std::path::{Path, PathBuf};

use super::SceneError;
use ostra_core::disk::AtomicFile;

/// Writes a file completely or not at all ([`AtomicFile`]).
///
/// # Errors
///
/// Returns the errors of `write`. A [`SceneError::Io`] without a path ([`unplaced`]) receives the
/// path of the file.
pub(super) fn write_whole(
    path: &Path,
    write: impl FnOnce(&mut File) -> Result<(), SceneError>,
) -> Result<(), SceneError> {
    let written = AtomicFile::create(path)
        .map_err(unplaced)
        .and_then(|mut file| {
            write(file.as_file())?;
            file.commit().map_err(unplaced)
        });
    written.map_err(|error| match error {
        SceneError::Io { path: none, reason } if none.as_os_str().is_empty() => SceneError::Io {
            path: path.to_path_buf(),
            reason,
        },
        other => other,
    })
}

/// Wraps a system error in a file whose path is not known here.
pub(super) fn unplaced(reason: Error) -> SceneError {
    SceneError::Io {
        path: PathBuf::new(),
        reason,
    }
}

use std::fs::File;
use std::io::Error;
use std::path::{Path, PathBuf};

use super::SceneError;

/// Writes a file whole or not at all: first under a temporary name beside it, then renamed, so that a stop or a full disk
/// leaves what was there.
///
/// # Errors
/// [`SceneError::Io`], with the file's path where `write` told none ([`unplaced`]); what else `write` says.
pub(super) fn write_whole(
    path: &Path,
    write: impl FnOnce(&mut File) -> Result<(), SceneError>,
) -> Result<(), SceneError> {
    let mut name = path.file_name().unwrap_or_default().to_os_string();
    name.push(format!(".{}.tmp", std::process::id()));
    let temporary = path.with_file_name(name);
    let written = write_file(&temporary, write).and_then(|()| std::fs::rename(&temporary, path).map_err(unplaced));
    if written.is_err() {
        let _ = std::fs::remove_file(&temporary);
    }
    written.map_err(|error| match error {
        SceneError::Io { path: none, source } if none.as_os_str().is_empty() => {
            SceneError::Io { path: path.to_path_buf(), source }
        }
        other => other,
    })
}

fn write_file(path: &Path, write: impl FnOnce(&mut File) -> Result<(), SceneError>) -> Result<(), SceneError> {
    let mut out = File::create(path).map_err(unplaced)?;
    write(&mut out)?;
    out.sync_all().map_err(unplaced)
}

/// A fault of the system in a file whose path is not known here.
pub(super) fn unplaced(source: Error) -> SceneError {
    SceneError::Io { path: PathBuf::new(), source }
}

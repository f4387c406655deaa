use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

/// Puts `bytes` in the place of the file's content so that a kill or a full disk at any moment leaves either the old
/// content or the new: temporary name, fsync, rename, fsync of the folder. Makes the folder where it is missing.
///
/// # Errors
/// When the file cannot be written; the old content stands.
pub fn replace(path: &Path, bytes: &[u8]) -> Result<()> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    make_folder(folder)?;
    let temporary = temporary(path);
    let written = File::create(&temporary).and_then(|mut file| {
        file.write_all(bytes)?;
        file.sync_all()
    });
    let placed = written.and_then(|()| fs::rename(&temporary, path));
    if placed.is_err() {
        let _ = fs::remove_file(&temporary);
    }
    placed.with_context(|| cannot_write(path))?;
    sync_folder(folder)
}

/// Makes a folder and those above it.
///
/// # Errors
/// When it cannot be made.
pub fn make_folder(folder: &Path) -> Result<()> {
    fs::create_dir_all(folder).with_context(|| cannot_write(folder))
}

/// Makes renames and removals in a folder durable (where the system can).
///
/// # Errors
/// When the system refuses.
pub fn sync_folder(folder: &Path) -> Result<()> {
    #[cfg(unix)]
    File::open(folder).and_then(|folder| folder.sync_all()).with_context(|| cannot_write(folder))?;
    #[cfg(not(unix))]
    let _ = folder;
    Ok(())
}

/// The name that a file has while it is written.
pub fn temporary(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".tmp");
    PathBuf::from(name)
}

/// One line for a file that cannot be written.
pub fn cannot_write(path: &Path) -> String {
    format!("{}: cannot be written; check permissions and free space", path.display())
}

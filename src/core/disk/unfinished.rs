use std::collections::BTreeSet;
use std::io::Result;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use tempfile::NamedTempFile;

/// The temporary files that this process writes to now.
static UNFINISHED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// Keeps a temporary file in the list of those that [`remove_unfinished`] removes, until this is dropped.
#[derive(Debug)]
pub struct Unfinished(PathBuf);

impl Unfinished {
    /// Lists a temporary file or folder that another program writes to, before it is started.
    #[must_use]
    pub fn list(path: &Path) -> Self {
        list().insert(path.to_owned());
        Self(path.to_owned())
    }

    /// Creates a temporary file and lists it. Both happen under one lock, so that [`remove_unfinished`] misses no file.
    pub(super) fn create(
        create: impl FnOnce() -> Result<NamedTempFile>,
    ) -> Result<(NamedTempFile, Self)> {
        let mut list = list();
        let file = create()?;
        let path = file.path().to_owned();
        list.insert(path.clone());
        Ok((file, Self(path)))
    }
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        list().remove(&self.0);
    }
}

/// Removes the temporary files that this process writes to. Only for a process that exits right after: no thread of it can
/// create another temporary file from then on.
pub fn remove_unfinished() {
    let list = list();
    list.iter().for_each(|path| remove(path));
    // Other threads still run until the process exits; they must not start another file.
    std::mem::forget(list);
}

fn remove(path: &Path) {
    if std::fs::remove_file(path).is_err() {
        let _ = std::fs::remove_dir_all(path);
    }
}

fn list() -> MutexGuard<'static, BTreeSet<PathBuf>> {
    UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner)
}

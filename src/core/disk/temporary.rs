use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fs::{self, File, OpenOptions};
use std::io::Result;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use tempfile::NamedTempFile;

/// Prefix of the names of temporary files.
pub(super) const PREFIX: &str = ".ostra-";
/// Suffix of the names of temporary files.
pub(super) const SUFFIX: &str = ".tmp";
/// The file in a temporary folder that is locked while the folder is in use.
pub(super) const LOCK: &str = ".lock";

/// Returns whether a name is that of a file that [`super::AtomicFile`] has not completed.
#[must_use]
pub fn is_temporary(name: &OsStr) -> bool {
    let name = name.to_string_lossy();
    name.starts_with(PREFIX) && name.ends_with(SUFFIX)
}

/// Removes the temporary files of killed processes from `folder`.
///
/// With `below`, subfolders are cleaned too. Files that a running process is writing are locked and
/// stay. Links to folders are not followed.
pub fn remove_leftovers(folder: &Path, below: bool) {
    let Ok(entries) = fs::read_dir(folder) else {
        return;
    };
    for entry in entries.flatten() {
        let Ok(kind) = entry.file_type() else {
            continue;
        };
        let (path, is_temporary) = (entry.path(), is_temporary(&entry.file_name()));
        if kind.is_dir() && is_temporary {
            if let Some(_lock) = lock_abandoned(&path.join(LOCK)) {
                let _ = fs::remove_dir_all(path);
            }
        } else if kind.is_dir() && below {
            remove_leftovers(&path, below);
        } else if kind.is_file()
            && is_temporary
            && let Some(_lock) = lock_abandoned(&path)
        {
            let _ = fs::remove_file(path);
        }
    }
}

/// Locks a temporary file that no process is writing, or returns `None`.
///
/// The lock is held until the file is removed: its creator may only now be about to lock it, waits,
/// and then sees that it is gone.
fn lock_abandoned(path: &Path) -> Option<File> {
    let file = OpenOptions::new().write(true).open(path).ok()?;
    file.try_lock().is_ok().then_some(file)
}

/// Temporary files that this process is writing.
static UNFINISHED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// Registers a temporary file for removal by [`remove_unfinished`] until this is dropped.
#[derive(Debug)]
pub struct Unfinished(PathBuf);

impl Unfinished {
    /// Registers a temporary file or folder of another program before that program is started.
    #[must_use]
    pub fn list(path: &Path) -> Self {
        list().insert(path.to_owned());
        Self(path.to_owned())
    }

    /// Creates and registers a temporary file.
    ///
    /// Both happen under one lock, so that [`remove_unfinished`] misses no file.
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

/// Removes the temporary files that this process is writing.
///
/// Only for a process that exits right after: no thread can create another temporary file from then
/// on.
pub fn remove_unfinished() {
    let list = list();
    list.iter().for_each(|path| remove(path));
    // Other threads keep running until the process exits; they must not create another file.
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

#[cfg(test)]
mod tests {
    use std::io::Write;
    use std::sync::atomic::{AtomicBool, Ordering};

    use super::*;
    use crate::disk::{AtomicFile, WorkFolder};

    #[test]
    fn leftovers_of_killed_processes_are_removed_and_files_being_written_stay() {
        let folder = tempfile::tempdir().unwrap();
        let inner = folder.path().join("inner");
        fs::create_dir(&inner).unwrap();
        for abandoned in [
            folder.path().join(".ostra-a.ply.x1.tmp"),
            inner.join(".ostra-b.x2.tmp"),
        ] {
            fs::write(abandoned, "half").unwrap();
        }
        fs::write(folder.path().join("notes.tmp"), "the user's").unwrap();
        let abandoned = folder.path().join(".ostra-x3.tmp");
        fs::create_dir(&abandoned).unwrap();
        fs::write(abandoned.join(LOCK), "").unwrap();
        let working = WorkFolder::create(folder.path()).unwrap();
        let mut writing = AtomicFile::create(&folder.path().join("c.ply")).unwrap();
        writing.write_all(b"whole").unwrap();
        remove_leftovers(folder.path(), false);
        assert_eq!(fs::read_dir(&inner).unwrap().count(), 1);
        remove_leftovers(folder.path(), true);
        assert_eq!(fs::read_dir(&inner).unwrap().count(), 0);
        assert!(working.path().is_dir() && !abandoned.exists());
        drop(working);
        writing.commit().unwrap();
        let mut names: Vec<_> = fs::read_dir(folder.path())
            .unwrap()
            .map(|entry| entry.unwrap().file_name())
            .collect();
        names.sort();
        assert_eq!(names, ["c.ply", "inner", "notes.tmp"]);
    }

    #[test]
    fn files_just_created_are_not_taken_for_leftovers() {
        let folder = tempfile::tempdir().unwrap();
        let is_done = AtomicBool::new(false);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                while !is_done.load(Ordering::Relaxed) {
                    remove_leftovers(folder.path(), false);
                }
            });
            let written = (0..500).map(|number| {
                let target = folder.path().join(format!("{}.json", number % 4));
                crate::disk::write(&target, b"whole")?;
                WorkFolder::create(folder.path())?;
                Ok(())
            });
            let written = written.collect::<Result<Vec<()>>>();
            is_done.store(true, Ordering::Relaxed);
            written.unwrap();
        });
    }
}

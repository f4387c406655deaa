use std::fs::{File, TryLockError};
use std::io::Error;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use ostra_core::disk::{self, AtomicFile};

/// How long to wait for the lock.
///
/// A program that is killed while it starts another one (ffmpeg) passes it the lock for a moment.
const PATIENCE: Duration = Duration::from_secs(1);

/// Lock against a second writer in a project's folder.
///
/// It is held until it is dropped or the process ends.
#[derive(Debug)]
pub struct Lock {
    file: File,
}

/// Why a project cannot be opened for writing.
#[derive(Debug, thiserror::Error)]
pub enum LockError {
    /// The folder is on read-only media, or belongs to another user.
    #[error("{}: cannot be written ({why}); a project needs a folder with write access", root.display())]
    NotWritable {
        /// The project's folder.
        root: PathBuf,
        /// Error of the system.
        why: Error,
    },
    /// Another process has the folder open for writing.
    #[error("{}: is open in another window or command; close it there first", .0.display())]
    Held(PathBuf),
    /// The file system does not support locks.
    #[error("{}: cannot be locked ({why}); move it to a local disk", root.display())]
    NotLockable {
        /// The project's folder.
        root: PathBuf,
        /// Error of the system.
        why: Error,
    },
}

impl Lock {
    /// Takes the lock of the folder `root`.
    ///
    /// # Errors
    ///
    /// Returns an error if another process holds it for at least a second, or the folder cannot be
    /// written.
    pub fn take(root: &Path) -> Result<Self, LockError> {
        let path = root.join(".lock");
        // The lock file may be writable in a folder that is not. Files could then be changed, but
        // not replaced.
        let opened = AtomicFile::create(&path).and_then(|_probe| disk::open_in_place(&path));
        let file = opened.map_err(|why| LockError::NotWritable {
            root: root.to_owned(),
            why,
        })?;
        match try_patiently(&file) {
            Ok(()) if disk::is_still_at(&file, &path) => Ok(Self { file }),
            // The holder removed the lock file because it failed to create a project.
            Ok(()) => Err(LockError::Held(root.to_owned())),
            Err(TryLockError::WouldBlock) => Err(LockError::Held(root.to_owned())),
            Err(TryLockError::Error(why)) => Err(LockError::NotLockable {
                root: root.to_owned(),
                why,
            }),
        }
    }
}

#[expect(
    clippy::disallowed_methods,
    reason = "a second at most, and only where another holds the project"
)]
fn try_patiently(file: &File) -> Result<(), TryLockError> {
    let begun = Instant::now();
    loop {
        match file.try_lock() {
            Err(TryLockError::WouldBlock) if begun.elapsed() < PATIENCE => {
                std::thread::sleep(Duration::from_millis(20));
            }
            answer => return answer,
        }
    }
}

impl Drop for Lock {
    /// Unlocks the file explicitly.
    ///
    /// Closing it is not enough: a process that is being started holds it for a moment longer.
    fn drop(&mut self) {
        // If unlocking fails, the lock ends with the process.
        let _ = self.file.unlock();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lock_excludes_a_second_writer_and_is_released_even_if_another_process_inherits_it() {
        let dir = tempfile::tempdir().unwrap();
        let lock = Lock::take(dir.path()).unwrap();
        assert!(
            Lock::take(dir.path())
                .unwrap_err()
                .to_string()
                .contains("close it there first")
        );
        let inherited = lock.file.try_clone().unwrap();
        drop(lock);
        Lock::take(dir.path()).unwrap();
        drop(inherited);
    }

    #[test]
    #[expect(
        clippy::disallowed_methods,
        reason = "the lock is given back a while after the next asks for it"
    )]
    fn process_started_by_a_killed_program_holds_the_lock_only_briefly() {
        let dir = tempfile::tempdir().unwrap();
        let held = Lock::take(dir.path()).unwrap();
        std::thread::scope(|scope| {
            let next = scope.spawn(|| Lock::take(dir.path()).map(drop));
            std::thread::sleep(PATIENCE / 4);
            drop(held);
            next.join().unwrap().unwrap();
        });
    }
}

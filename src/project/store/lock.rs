use std::fs::{File, TryLockError};
use std::io::Error;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use ostra_core::disk::{self, AtomicFile};

/// A program that is killed while it starts another (ffmpeg) leaves it the lock for an instant: so long is waited.
const PATIENCE: Duration = Duration::from_secs(1);

/// Keeps a second writer out of a project's folder until it is dropped (or the process ends).
#[derive(Debug)]
pub struct Lock {
    file: File,
}

/// Why a project cannot be opened for writing.
#[derive(Debug, thiserror::Error)]
pub enum LockError {
    /// The folder is on read-only media, or belongs to somebody else.
    #[error("{}: cannot be written ({why}); a project needs a folder with write access", root.display())]
    NotWritable {
        /// The project's folder.
        root: PathBuf,
        /// What the system says.
        why: Error,
    },
    /// Another process writes there.
    #[error("{}: is open in another window or command; close it there first", .0.display())]
    Held(PathBuf),
    /// The disk has no locks.
    #[error("{}: cannot be locked ({why}); move it to a local disk", root.display())]
    NotLockable {
        /// The project's folder.
        root: PathBuf,
        /// What the system says.
        why: Error,
    },
}

impl Lock {
    /// Takes the lock of the folder `root`.
    ///
    /// # Errors
    /// When another holds it (for a second at least), or the folder cannot be written.
    pub fn take(root: &Path) -> Result<Self, LockError> {
        let path = root.join(".lock");
        // The lock may be writable in a folder that is not: files could be changed there, but none replaced.
        let opened = AtomicFile::create(&path).and_then(|_probe| disk::open_in_place(&path));
        let file = opened.map_err(|why| LockError::NotWritable {
            root: root.to_owned(),
            why,
        })?;
        match try_patiently(&file) {
            Ok(()) if disk::is_still_at(&file, &path) => Ok(Self { file }),
            // Who held it has removed it, after a project could not be made.
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
    /// Closing the file is not enough: a process that is being started at this moment holds it for an instant longer.
    fn drop(&mut self) {
        // A lock that cannot be given back ends with the process.
        let _ = self.file.unlock();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lock_keeps_a_second_writer_out_and_is_given_back_even_while_another_process_inherits_it() {
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
    fn what_a_killed_program_was_starting_holds_the_lock_for_an_instant_only() {
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

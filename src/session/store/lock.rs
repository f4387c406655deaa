use std::fs::{File, OpenOptions, TryLockError};
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow, bail};

use super::durable;

/// A program that is killed while it starts another (ffmpeg) leaves it the lock for an instant: so long is waited.
const PATIENCE: Duration = Duration::from_secs(1);

/// Keeps a second writer out of a project's folder until it is dropped (or the process ends).
#[derive(Debug)]
pub struct Lock {
    file: File,
}

impl Lock {
    /// Takes the lock of the folder `root`.
    ///
    /// # Errors
    /// When another holds it (for a second at least), or the folder cannot be written.
    pub fn take(root: &Path) -> Result<Self> {
        let path = root.join(".lock");
        let file = OpenOptions::new().create(true).truncate(false).write(true).open(&path);
        let file = file.and_then(|file| check_writable(root).map(|()| file)).with_context(|| {
            format!("{}: cannot be written; a project needs a folder with write access", root.display())
        })?;
        match try_patiently(&file) {
            Ok(()) => Ok(Self { file }),
            Err(TryLockError::WouldBlock) => {
                bail!("{}: is open in another window or command; close it there first", root.display())
            }
            Err(TryLockError::Error(error)) => {
                Err(anyhow!(error).context(format!("{}: cannot be locked; move it to a local disk", root.display())))
            }
        }
    }
}

#[expect(clippy::disallowed_methods, reason = "a second at most, and only where another holds the project")]
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

/// The lock may be writable in a folder that is not: files could be changed there, but none replaced.
fn check_writable(root: &Path) -> std::io::Result<()> {
    let probe = durable::temporary(&root.join(".lock"));
    File::create(&probe)?;
    std::fs::remove_file(&probe)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lock_keeps_a_second_writer_out_and_is_given_back_even_while_another_process_inherits_it() {
        let dir = tempfile::tempdir().unwrap();
        let lock = Lock::take(dir.path()).unwrap();
        assert!(Lock::take(dir.path()).unwrap_err().to_string().contains("close it there first"));
        let inherited = lock.file.try_clone().unwrap();
        drop(lock);
        Lock::take(dir.path()).unwrap();
        drop(inherited);
    }

    #[test]
    #[expect(clippy::disallowed_methods, reason = "the lock is given back a while after the next asks for it")]
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

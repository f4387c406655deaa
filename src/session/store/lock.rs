use std::fs::{File, OpenOptions, TryLockError};
use std::path::Path;

use anyhow::{Context, Result, anyhow, bail};

use super::durable;

/// Keeps a second writer out of a project's folder until it is dropped (or the process ends).
#[derive(Debug)]
pub struct Lock {
    file: File,
}

impl Lock {
    /// Takes the lock of the folder `root`.
    ///
    /// # Errors
    /// When another holds it, or the folder cannot be written.
    pub fn take(root: &Path) -> Result<Self> {
        let path = root.join(".lock");
        let file = OpenOptions::new().create(true).truncate(false).write(true).open(&path);
        let file = file.and_then(|file| check_writable(root).map(|()| file)).with_context(|| {
            format!("{}: cannot be written; a project needs a folder with write access", root.display())
        })?;
        match file.try_lock() {
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
}

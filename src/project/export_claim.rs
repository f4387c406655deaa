//! Which files running exports write at this moment, so that two of them do not mix what they write.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::Write;
use std::path::Path;

use anyhow::{Context, Result, ensure};

use ostra_core::disk::{self, AtomicFile};

/// Stands for all files of a folder.
pub(super) const WHOLE_FOLDER: &str = "";
/// A file under a temporary name that begins with this name lists what an export writes; it is locked while the export runs
/// and never completed.
const CLAIM: &str = "exporting";
/// How the names of such files begin.
const CLAIM_PREFIX: &str = ".ostra-exporting.";
/// Room for each name in the record of a folder's exports, which is written when the disk may be full.
const RECORD_BYTES: usize = 256;
/// Room for the rest of that record.
const MORE_BYTES: usize = 1 << 16;
/// A longer list was not written by this program.
const MAX_BYTES: u64 = 1 << 30;

/// Files of a folder that this process writes now, until it is dropped. It takes as much room on the disk as the note of what
/// was written will need, so that a disk that becomes full does not keep the note from being written.
#[derive(Debug)]
pub struct Claim {
    _file: AtomicFile,
}

impl Claim {
    /// Claims files of a folder by their names below it. The folder must be locked ([`lock_folder`]).
    ///
    /// # Errors
    /// When another export writes one of them now, or the disk is full.
    pub fn take(folder: &Path, names: &[String]) -> Result<Self> {
        if let Some(name) = names.iter().find(|name| is_being_written(folder, name)) {
            let file = folder.join(name);
            ensure!(
                false,
                "{}: another export writes here now; start this one when that has ended",
                file.display()
            );
        }
        let write = || -> std::io::Result<AtomicFile> {
            let mut file = AtomicFile::create(&folder.join(CLAIM))?;
            let mut bytes = serde_json::to_vec(names)?;
            let room = fs::metadata(folder.join(crate::export_record::RECORD))
                .map_or(0, |record| record.len() as usize);
            bytes.resize(
                bytes.len() + room + RECORD_BYTES * names.len() + MORE_BYTES,
                b' ',
            );
            file.write_all(&bytes)?;
            file.as_file().sync_data()?;
            Ok(file)
        };
        let file = write().map_err(|error| {
            anyhow::anyhow!("{}: {}", folder.display(), disk::write_fault(&error))
        })?;
        Ok(Self { _file: file })
    }
}

/// Whether another export writes this file of a folder now.
pub fn is_being_written(folder: &Path, name: &str) -> bool {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let is_claim = |entry: &fs::DirEntry| {
        let name = entry.file_name();
        disk::is_temporary(&name) && name.to_string_lossy().starts_with(CLAIM_PREFIX)
    };
    entries.filter(is_claim).any(|entry| {
        let is_running = OpenOptions::new()
            .write(true)
            .open(entry.path())
            .is_ok_and(|file| matches!(file.try_lock(), Err(TryLockError::WouldBlock)));
        if !is_running {
            return false;
        }
        let text = disk::read_text_up_to(&entry.path(), MAX_BYTES).unwrap_or_default();
        // One that cannot be read may be of any file.
        let names: Vec<String> =
            serde_json::from_str(&text).unwrap_or_else(|_| vec![WHOLE_FOLDER.to_owned()]);
        name == WHOLE_FOLDER
            || names
                .iter()
                .any(|other| other == name || other == WHOLE_FOLDER)
    })
}

/// Keeps other exports from changing the record of a folder until it is dropped; waits for those that do. `None` where the
/// system has no such locks.
///
/// # Errors
/// When the folder cannot be opened.
pub fn lock_folder(folder: &Path) -> Result<Option<File>> {
    if cfg!(not(unix)) {
        return Ok(None);
    }
    let file = File::open(folder)
        .with_context(|| format!("{}: cannot be read; check permissions", folder.display()))?;
    let is_locked = file.lock().is_ok();
    Ok(is_locked.then_some(file))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_claimed_cannot_be_claimed_again_until_it_is_given_back() {
        let dir = tempfile::tempdir().unwrap();
        let claim = |names: &[&str]| {
            Claim::take(
                dir.path(),
                &names
                    .iter()
                    .map(|&name| name.to_owned())
                    .collect::<Vec<_>>(),
            )
        };
        let first = claim(&["a.ply", "a_leaf.ply"]).unwrap();
        let second = claim(&["b.ply"]).unwrap();
        let error = claim(&["c.ply", "a.ply"]).unwrap_err().to_string();
        assert!(
            error.contains("a.ply: another export writes here now"),
            "{error}"
        );
        assert!(claim(&[WHOLE_FOLDER]).is_err());
        drop((first, second));
        let whole = claim(&[WHOLE_FOLDER]).unwrap();
        assert!(claim(&["b.ply"]).is_err());
        drop(whole);
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
    }

    #[test]
    fn what_a_killed_export_claimed_is_free() {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join(".ostra-exporting.x.tmp"), r#"["a.ply"]"#).unwrap();
        Claim::take(dir.path(), &["a.ply".to_owned()]).unwrap();
    }
}

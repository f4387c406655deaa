//! Records of the files that OSTRA exported, and claims on the files that running exports write.
//!
//! The claims prevent two exports from mixing their files.

use std::collections::BTreeMap;
use std::fs::{self, File, Metadata, OpenOptions, TryLockError};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

use anyhow::{Context, Result, ensure};
use serde::{Deserialize, Serialize};

use ostra_core::disk::{self, AtomicFile};

/// Name of the file in a folder that lists what OSTRA exported into it.
pub const RECORD: &str = ".ostra-exports.json";

/// Files that operating systems and OSTRA itself put into folders; never the user's work.
const SYSTEM_FILES: [&str; 4] = [".DS_Store", "Thumbs.db", "desktop.ini", RECORD];

/// Identity of a file, independent of its path.
///
/// Links and hard links have the id of their target.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum FileId {
    #[cfg(unix)]
    Inode(u64, u64),
    #[cfg(not(unix))]
    Path(PathBuf),
}

impl FileId {
    #[cfg(unix)]
    pub(super) fn of(path: &Path) -> Option<Self> {
        use std::os::unix::fs::MetadataExt;
        let found = fs::metadata(path).ok()?;
        Some(Self::Inode(found.dev(), found.ino()))
    }

    #[cfg(not(unix))]
    pub(super) fn of(path: &Path) -> Option<Self> {
        path.canonicalize().ok().map(Self::Path)
    }
}

/// Size and time of an exported file, to detect changes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Exported {
    bytes: u64,
    /// Modification time, in nanoseconds since 1970.
    modified_ns: u128,
}

impl Exported {
    fn of(found: &Metadata) -> Self {
        let modified = found
            .modified()
            .ok()
            .and_then(|time| time.duration_since(UNIX_EPOCH).ok());
        Self {
            bytes: found.len(),
            modified_ns: modified.map_or(0, |time| time.as_nanos()),
        }
    }
}

/// Identity and state of a file.
///
/// The stamp changes if the file is modified or replaced by another one.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Stamp {
    id: FileId,
    exported: Exported,
}

impl Stamp {
    pub(super) fn of(path: &Path) -> Option<Self> {
        Some(Self {
            id: FileId::of(path)?,
            exported: Exported::of(&fs::symlink_metadata(path).ok()?),
        })
    }
}

/// State of a file in a folder of exports.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExportFileState {
    /// Unchanged since OSTRA exported it.
    Unchanged,
    /// Exported by OSTRA and changed since.
    Changed,
    /// Possibly written by an export that was killed, or by another program since then.
    Interrupted,
}

/// The exported files of a folder, by their path below it, with `/` as separator.
#[derive(Debug, Default, Serialize, Deserialize)]
pub struct ExportRecord {
    pub(super) files: BTreeMap<String, Exported>,
    /// Files that an export is writing or was writing when it was killed, with its start time.
    ///
    /// [`WHOLE_FOLDER`] stands for all files of the folder.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub(super) pending: BTreeMap<String, u128>,
}

/// Maximum size of a record that is read. A record of a million files takes a sixth of it.
const MAX_BYTES: u64 = 1 << 30;

impl ExportRecord {
    /// Reads the record of a folder.
    ///
    /// If it is missing or cannot be read, no file counts as exported.
    #[must_use]
    pub fn read(folder: &Path, name: &str) -> Self {
        let text = disk::read_text_up_to(&folder.join(name), MAX_BYTES).unwrap_or_default();
        serde_json::from_str(&text).unwrap_or_default()
    }

    /// Writes the record into the folder.
    ///
    /// # Errors
    ///
    /// Returns an error if the file cannot be written.
    pub fn write(&self, folder: &Path, name: &str) -> Result<()> {
        let path = folder.join(name);
        disk::write(&path, &serde_json::to_vec_pretty(self)?).with_context(|| {
            format!(
                "{}: cannot be written; check permissions and free space",
                path.display()
            )
        })
    }

    /// Adds a file of the folder in its current state.
    pub fn add(&mut self, folder: &Path, file: &Path) {
        if let (Some(name), Ok(found)) = (name_below(folder, file), fs::metadata(file)) {
            self.files.insert(name, Exported::of(&found));
        }
    }

    /// Returns the state of a file in the folder, or `None` if OSTRA did not write it.
    #[must_use]
    pub fn state_of(&self, folder: &Path, file: &Path) -> Option<ExportFileState> {
        let name = name_below(folder, file)?;
        let found = fs::symlink_metadata(file)
            .ok()
            .filter(Metadata::is_file)
            .map(|found| Exported::of(&found));
        if found.is_some() && self.files.get(&name) == found.as_ref() {
            return Some(ExportFileState::Unchanged);
        }
        let began = self
            .pending
            .get(&name)
            .or_else(|| self.pending.get(WHOLE_FOLDER));
        if let (Some(began), Some(found)) = (began, &found)
            && found.modified_ns >= *began
        {
            return Some(ExportFileState::Interrupted);
        }
        self.files
            .contains_key(&name)
            .then_some(ExportFileState::Changed)
    }
}

pub(super) fn name_below(folder: &Path, file: &Path) -> Option<String> {
    // A name without a folder lies in the current one.
    let below = match file.strip_prefix(folder) {
        Ok(below) => below,
        Err(_) if folder == Path::new(".") => file,
        Err(_) => return None,
    };
    Some(
        below
            .components()
            .map(|part| part.as_os_str().to_string_lossy())
            .collect::<Vec<_>>()
            .join("/"),
    )
}

/// Returns all files and links in a folder and its subfolders, sorted.
///
/// System files and temporary files are left out.
///
/// # Errors
///
/// Returns an error if a folder cannot be read.
pub fn files_below(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    let mut waiting = vec![folder.to_owned()];
    while let Some(folder) = waiting.pop() {
        let cannot = || format!("{}: cannot be read; check permissions", folder.display());
        for entry in fs::read_dir(&folder).with_context(cannot)? {
            let entry = entry.with_context(cannot)?;
            let name = entry.file_name();
            let is_system =
                SYSTEM_FILES.iter().any(|system| name == *system) || disk::is_temporary(&name);
            if entry.file_type().with_context(cannot)?.is_dir() {
                waiting.push(entry.path());
            } else if !is_system {
                found.push(entry.path());
            }
        }
    }
    found.sort();
    Ok(found)
}

/// Name in claims and records that stands for all files of a folder.
pub(super) const WHOLE_FOLDER: &str = "";
/// Name from which the temporary names of claim files are made.
///
/// A claim file lists the files that an export writes. It is locked while the export runs and is
/// never completed.
const CLAIM: &str = "exporting";
/// Prefix of the names of claim files.
const CLAIM_PREFIX: &str = ".ostra-exporting.";
/// Bytes reserved for each name in the export record.
///
/// The record must be written even if the disk is full.
const RECORD_BYTES: usize = 256;
/// Bytes reserved for the rest of that record.
const MORE_BYTES: usize = 1 << 16;
/// Maximum size of a claim file. A longer one was not written by this program.
const MAX_CLAIM_BYTES: u64 = 1 << 30;

/// Files of a folder that this process is writing; the claim ends when it is dropped.
///
/// The claim file takes as much disk space as the record of the written files will need. The record
/// can therefore be written even if the disk becomes full.
#[derive(Debug)]
pub struct ExportClaim {
    _file: AtomicFile,
}

impl ExportClaim {
    /// Claims files of a folder by their names below it.
    ///
    /// The folder must be locked with [`lock_folder`].
    ///
    /// # Errors
    ///
    /// Returns an error if another export is writing one of them, or the disk is full.
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
            let room = fs::metadata(folder.join(RECORD)).map_or(0, |record| record.len() as usize);
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

/// Returns whether another export is writing this file of a folder.
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
        let text = disk::read_text_up_to(&entry.path(), MAX_CLAIM_BYTES).unwrap_or_default();
        // An unreadable claim may be for any file.
        let names: Vec<String> =
            serde_json::from_str(&text).unwrap_or_else(|_| vec![WHOLE_FOLDER.to_owned()]);
        name == WHOLE_FOLDER
            || names
                .iter()
                .any(|other| other == name || other == WHOLE_FOLDER)
    })
}

/// Locks the record of a folder against other exports until the returned file is dropped.
///
/// Waits for other exports that hold the lock. Returns `None` if the system has no such locks.
///
/// # Errors
///
/// Returns an error if the folder cannot be opened.
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
    fn claimed_files_cannot_be_claimed_again_until_released() {
        let dir = tempfile::tempdir().unwrap();
        let claim = |names: &[&str]| {
            ExportClaim::take(
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
    fn files_claimed_by_a_killed_export_are_free() {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join(".ostra-exporting.x.tmp"), r#"["a.ply"]"#).unwrap();
        ExportClaim::take(dir.path(), &["a.ply".to_owned()]).unwrap();
    }
}

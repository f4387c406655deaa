//! Folders of files that may be deleted at any time, limited in bytes.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// A file that is kept until its space is needed.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct KeptFile {
    /// Time when it was written, or marked by [`mark_used`].
    pub used: SystemTime,
    /// Size in bytes.
    pub bytes: u64,
    /// Path of the file.
    pub path: PathBuf,
}

/// Returns the files whose names `is_kept` accepts, least recently used first.
///
/// Returns nothing if the folder cannot be read.
#[must_use]
pub fn kept_files(folder: &Path, is_kept: impl Fn(&OsStr) -> bool) -> Vec<KeptFile> {
    let about = |entry: fs::DirEntry| {
        // Links are not followed.
        let about = entry.metadata().ok()?;
        Some(KeptFile {
            used: about.modified().ok()?,
            bytes: about.len(),
            path: entry.path(),
        })
    };
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut files: Vec<_> = entries
        .filter(|entry| is_kept(&entry.file_name()))
        .filter_map(about)
        .collect();
    files.sort();
    files
}

/// Removes files from the front of the list until the rest takes at most `budget_bytes`.
pub fn remove_beyond(files: Vec<KeptFile>, budget_bytes: u64) {
    let mut bytes: u64 = files.iter().map(|file| file.bytes).sum();
    for file in files {
        if bytes <= budget_bytes {
            break;
        }
        bytes -= file.bytes;
        let _ = fs::remove_file(file.path);
    }
}

/// Marks a file as used now, so that others are removed first.
pub fn mark_used(path: &Path) {
    let _ = File::options()
        .write(true)
        .open(path)
        .and_then(|file| file.set_modified(SystemTime::now()));
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn least_recently_used_files_are_removed_first() {
        let folder = tempfile::tempdir().unwrap();
        for (age, name) in ["a.bin", "b.bin", "c.bin", "other"].into_iter().enumerate() {
            let path = folder.path().join(name);
            fs::write(&path, [0; 10]).unwrap();
            let time = SystemTime::now() - Duration::from_secs(100 - age as u64);
            File::options()
                .write(true)
                .open(&path)
                .unwrap()
                .set_modified(time)
                .unwrap();
        }
        let kept = || kept_files(folder.path(), |name| name != "other");
        let names = || -> Vec<_> {
            let name = |file: KeptFile| file.path.file_name().unwrap().to_owned();
            kept().into_iter().map(name).collect()
        };
        assert_eq!(names(), ["a.bin", "b.bin", "c.bin"]);
        mark_used(&folder.path().join("a.bin"));
        assert_eq!(names(), ["b.bin", "c.bin", "a.bin"]);
        remove_beyond(kept(), 20);
        assert_eq!(names(), ["c.bin", "a.bin"]);
        remove_beyond(kept(), 19);
        assert_eq!(names(), ["a.bin"]);
        assert!(folder.path().join("other").exists());
        assert!(kept_files(&folder.path().join("missing"), |_| true).is_empty());
    }
}

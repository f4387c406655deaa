use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use crate::MaskError;
use ostra_core::disk;
use ostra_core::job::Progress;
use ostra_frames::natural_order;

/// A file found below a folder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct FoundFile {
    /// Path of the file.
    pub path: PathBuf,
    /// Path relative to the folder, with parts joined by `/` and without extension.
    pub stem: String,
}

/// Lists all files below a folder with one of the extensions, in natural order of stems.
///
/// `endings` are lower case and match any case. Hidden files and those of operating systems and
/// network storage are skipped.
pub(crate) fn list_files(dir: &Path, endings: &[&str]) -> Result<Vec<FoundFile>, MaskError> {
    let mut found = Vec::new();
    let mut open = vec![dir.to_path_buf()];
    while let Some(folder) = open.pop() {
        for entry in std::fs::read_dir(&folder).map_err(io_error(&folder))? {
            let entry = entry.map_err(io_error(&folder))?;
            let path = entry.path();
            let name = entry.file_name();
            let name = name.to_string_lossy();
            if name.starts_with('.') || disk::is_system_file(&name) {
                continue;
            }
            // Links to files are followed. Links to folders are not, because they could form a
            // cycle.
            if entry.file_type().map_err(io_error(&path))?.is_dir() {
                open.push(path);
            } else if has_ending(&path, endings) {
                found.push(FoundFile {
                    stem: stem_below(dir, &path),
                    path,
                });
            }
        }
    }
    found.sort_by(|a, b| natural_order(&a.stem, &b.stem).then_with(|| a.path.cmp(&b.path)));
    Ok(found)
}

/// Writes a file atomically ([`disk::write`]) and creates its parent folders.
pub(super) fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), MaskError> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(io_error(folder))?;
    }
    disk::write(path, bytes).map_err(io_error(path))
}

/// Applies `work` to every item on all cores and reports progress.
///
/// Returns the first error in the order of the items.
pub(crate) fn in_parallel<T: Sync, R: Send>(
    items: &[T],
    progress: &Progress,
    work: impl Fn(&T) -> Result<R, MaskError> + Sync,
) -> Result<Vec<R>, MaskError> {
    let done = AtomicUsize::new(0);
    let results: Vec<Result<R, MaskError>> = items
        .par_iter()
        .map(|item| {
            progress.check()?;
            let result = work(item)?;
            progress.step(done.fetch_add(1, Ordering::Relaxed) + 1, items.len())?;
            Ok(result)
        })
        .collect();
    results.into_iter().collect()
}

/// Turns a failure into a value so that work on other items continues.
///
/// A stop remains an error.
pub(crate) fn unless_stopped<R>(
    result: Result<R, MaskError>,
) -> Result<Result<R, MaskError>, MaskError> {
    match result {
        Err(error @ MaskError::Stopped(_)) => Err(error),
        result => Ok(result),
    }
}

/// Reads a text file, skipping a byte-order mark.
pub(super) fn read_text(path: &Path) -> Result<String, MaskError> {
    disk::read_text(path).map_err(|error| match error.kind() {
        std::io::ErrorKind::InvalidData => invalid(path, "is not UTF-8 text; save it as UTF-8"),
        _ => io_error(path)(error),
    })
}

/// Adds the file's path to an I/O error.
pub(super) fn io_error(path: &Path) -> impl FnOnce(std::io::Error) -> MaskError + '_ {
    move |reason| MaskError::Io {
        path: path.to_path_buf(),
        reason,
    }
}

/// Creates an error about the content of a file.
pub(super) fn invalid(path: &Path, what: impl Into<String>) -> MaskError {
    MaskError::Invalid {
        path: path.to_path_buf(),
        what: what.into(),
    }
}

fn has_ending(path: &Path, endings: &[&str]) -> bool {
    let ending = path
        .extension()
        .unwrap_or_default()
        .to_string_lossy()
        .to_ascii_lowercase();
    endings.contains(&ending.as_str())
}

fn stem_below(dir: &Path, path: &Path) -> String {
    let below = path.strip_prefix(dir).unwrap_or(path).with_extension("");
    let parts: Vec<_> = below
        .components()
        .map(|part| part.as_os_str().to_string_lossy())
        .collect();
    parts.join("/")
}

/// Faults that an import skipped or corrected, with the count and first place per kind.
#[derive(Debug, Default)]
pub(crate) struct Skipped(BTreeMap<&'static str, Occurrences>);

#[derive(Debug)]
struct Occurrences {
    count: usize,
    first: String,
}

impl Skipped {
    /// Counts a fault.
    ///
    /// `kind` continues a sentence after a number: "polygons of fewer than three corners were left
    /// out".
    pub(crate) fn add(&mut self, kind: &'static str, place: impl Into<String>) {
        self.0
            .entry(kind)
            .or_insert_with(|| Occurrences {
                count: 0,
                first: place.into(),
            })
            .count += 1;
    }

    /// Adds the counts of a later part of the file.
    pub(crate) fn join(&mut self, later: Self) {
        for (kind, found) in later.0 {
            let count = found.count;
            self.0
                .entry(kind)
                .or_insert(Occurrences { count: 0, ..found })
                .count += count;
        }
    }

    /// Counts a file that was skipped because it is unreadable or differs in size from its frame.
    pub(crate) fn add_unreadable(&mut self, error: &MaskError) {
        self.add("files cannot be used and were left out", error.to_string());
    }

    /// Returns whether no fault was counted.
    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Returns one sentence per kind of fault, for the user.
    pub(crate) fn warnings(&self) -> impl Iterator<Item = String> {
        self.0
            .iter()
            .map(|(kind, Occurrences { count, first })| match count {
                1 => format!("{count} {kind} ({first})"),
                _ => format!("{count} {kind} (first: {first})"),
            })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_listed_in_natural_order_without_system_files() {
        let dir = tempfile::tempdir().unwrap();
        for name in [
            "f10.PNG",
            "f9.png",
            "a/f1.png",
            "notes.txt",
            ".hidden.png",
            "f010b.png",
        ]
        .into_iter()
        .chain([
            "@eaDir/f1.png",
            "a/#recycle/f2.png",
            "__MACOSX/f3.png",
            "SYNOPHOTO_THUMB_M.png",
        ]) {
            write_whole(&dir.path().join(name), b"x").unwrap();
        }
        let stems: Vec<String> = list_files(dir.path(), &["png"])
            .unwrap()
            .into_iter()
            .map(|file| file.stem)
            .collect();
        assert_eq!(stems, ["a/f1", "f9", "f10", "f010b"]);
        assert!(list_files(&dir.path().join("none"), &["png"]).is_err());
    }

    #[test]
    fn failed_write_leaves_no_file_behind() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::create_dir_all(dir.path().join("taken/inside")).unwrap();
        let error = write_whole(&dir.path().join("taken"), b"x").unwrap_err();
        assert!(error.to_string().contains("taken"), "{error}");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
        assert!(write_whole(&dir.path().join("taken/inside/file/below"), b"x").is_ok());
        assert!(write_whole(&dir.path().join("taken/inside/file/below/it"), b"x").is_err());
    }

    #[test]
    fn first_error_in_item_order_is_returned() {
        let items: Vec<usize> = (0..100).collect();
        let work = |&at: &usize| {
            if at % 30 == 29 {
                Err(MaskError::Request(at.to_string()))
            } else {
                Ok(at)
            }
        };
        let error = in_parallel(&items, &Progress::default(), work).unwrap_err();
        assert_eq!(error.to_string(), "29");
        let stopped = Progress::default();
        stopped.stop();
        assert!(matches!(
            in_parallel(&items, &stopped, |_| Ok(())),
            Err(MaskError::Stopped(_))
        ));
    }
}

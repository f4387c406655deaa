//! What is there of unfinished downloads.

use std::fs;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use ostra_core::disk;

/// Maximum size of a record; a larger one is damaged.
const MAX_RECORD_BYTES: u64 = 1 << 20;
/// End of the name of a file that is not complete.
const PART: &str = ".part";
/// End of the name of the record of such a file.
const RECORD: &str = ".part.toml";

/// Paths of a download that is not complete.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct UnfinishedPaths {
    /// File that receives the bytes. Parts that are missing in it are holes.
    pub data: PathBuf,
    /// Record of the bytes that are there, a [`Unfinished`].
    pub record: PathBuf,
}

impl UnfinishedPaths {
    /// Returns the paths for a download to `into`, which are next to it.
    pub fn of(into: &Path) -> Self {
        let with = |suffix: &str| {
            let mut name = into.as_os_str().to_owned();
            name.push(suffix);
            PathBuf::from(name)
        };
        Self {
            data: with(PART),
            record: with(RECORD),
        }
    }

    /// Deletes both files.
    pub fn discard(&self) -> std::io::Result<()> {
        // The record comes first: it must never describe other data.
        for path in [&self.record, &self.data] {
            match fs::remove_file(path) {
                Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(error),
                _ => {}
            }
        }
        Ok(())
    }
}

/// What a server states about the version of a file.
#[derive(Debug, Clone, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FileVersion {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub etag: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub last_modified: Option<String>,
}

impl FileVersion {
    /// Returns whether two files of the same version have the same bytes.
    ///
    /// A weak `ETag` (`W/"…"`) does not promise that.
    pub fn is_exact(&self) -> bool {
        let is_strong = |etag: &String| !etag.starts_with("W/");
        self.etag.as_ref().is_some_and(is_strong) || self.last_modified.is_some()
    }
}

/// A stretch of a file, from its start to where the next one starts.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Stretch {
    pub start: u64,
    /// First byte that is missing.
    pub at: u64,
    /// The byte after the last one; `None` if the size of the file is not known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub end: Option<u64>,
}

impl Stretch {
    pub fn new(start: u64, end: Option<u64>) -> Self {
        Self {
            start,
            at: start,
            end,
        }
    }

    pub fn is_complete(&self) -> bool {
        self.end.is_some_and(|end| self.at >= end)
    }
}

/// Record of a download that is not complete.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Unfinished {
    pub url: String,
    /// Size of the whole file, if known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub size: Option<u64>,
    #[serde(default)]
    pub version: FileVersion,
    /// All bytes of the file, in their order.
    pub stretches: Vec<Stretch>,
}

impl Unfinished {
    /// Reads the record of a download.
    ///
    /// Returns `None` if there is none, it is of another address, or it does not fit the data.
    pub fn read(paths: &UnfinishedPaths, url: &str) -> Option<Self> {
        let text = disk::read_text_up_to(&paths.record, MAX_RECORD_BYTES).ok()?;
        let record: Self = toml::from_str(&text).ok()?;
        let length = fs::metadata(&paths.data).ok()?.len();
        let has_data = |stretch: &Stretch| stretch.at == stretch.start || stretch.at <= length;
        let fits = record.url == url
            && record.is_gapless()
            && record.stretches.iter().all(has_data)
            && record.bytes() > 0;
        fits.then_some(record)
    }

    /// Writes the record. The bytes that it lists must be on the disk already.
    pub fn write(&self, paths: &UnfinishedPaths) -> std::io::Result<()> {
        let text = toml::to_string(self).map_err(std::io::Error::other)?;
        disk::write(&paths.record, text.as_bytes())
    }

    /// Returns the number of bytes that are there.
    pub fn bytes(&self) -> u64 {
        let bytes = |stretch: &Stretch| stretch.at.saturating_sub(stretch.start);
        self.stretches.iter().map(bytes).sum()
    }

    fn is_gapless(&self) -> bool {
        let mut end = Some(0);
        for stretch in &self.stretches {
            let fits = end == Some(stretch.start)
                && stretch.at >= stretch.start
                && stretch.end.is_none_or(|end| stretch.at <= end);
            if !fits {
                return false;
            }
            end = stretch.end;
        }
        !self.stretches.is_empty() && end == self.size
    }
}

/// Returns the number of downloaded bytes in a folder of downloads.
pub(super) fn downloaded_bytes(folder: &Path) -> u64 {
    let Ok(files) = fs::read_dir(folder) else {
        return 0;
    };
    let bytes = |path: PathBuf| {
        let name = path.file_name()?.to_str()?;
        if name.ends_with(RECORD) {
            let text = disk::read_text_up_to(&path, MAX_RECORD_BYTES).ok()?;
            return Some(toml::from_str::<Unfinished>(&text).ok()?.bytes());
        }
        // Its length counts bytes that are missing.
        if name.ends_with(PART) {
            return None;
        }
        Some(path.metadata().ok()?.len())
    };
    files.flatten().filter_map(|file| bytes(file.path())).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unfinished() -> Unfinished {
        Unfinished {
            url: "https://s/f".into(),
            size: Some(100),
            version: FileVersion {
                etag: Some("\"a\"".into()),
                last_modified: None,
            },
            stretches: vec![
                Stretch::new(0, Some(40)),
                Stretch {
                    start: 40,
                    at: 60,
                    end: Some(100),
                },
            ],
        }
    }

    #[test]
    fn record_that_does_not_fit_the_data_is_not_used() {
        let folder = tempfile::tempdir().unwrap();
        let paths = UnfinishedPaths::of(&folder.path().join("f"));
        let written = unfinished();
        written.write(&paths).unwrap();
        let read = || Unfinished::read(&paths, "https://s/f");
        assert_eq!(read(), None, "no data");
        fs::write(&paths.data, [0; 59]).unwrap();
        assert_eq!(read(), None, "less data than recorded");
        fs::write(&paths.data, [0; 60]).unwrap();
        assert_eq!(read(), Some(written.clone()));
        assert_eq!(downloaded_bytes(folder.path()), 20);
        assert_eq!(Unfinished::read(&paths, "https://s/g"), None);
        let broken = |change: fn(&mut Unfinished)| {
            let mut record = unfinished();
            change(&mut record);
            record.write(&paths).unwrap();
            read()
        };
        assert_eq!(broken(|record| record.stretches[1].start = 50), None);
        assert_eq!(broken(|record| record.stretches[0].at = 41), None);
        assert_eq!(broken(|record| record.size = Some(101)), None);
        assert_eq!(broken(|record| record.stretches.clear()), None);
        fs::write(&paths.record, "url = 'https://s/f'").unwrap();
        assert_eq!(read(), None);
    }

    #[test]
    fn weak_etag_is_not_exact() {
        let version = |etag: Option<&str>, last_modified: Option<&str>| FileVersion {
            etag: etag.map(str::to_owned),
            last_modified: last_modified.map(str::to_owned),
        };
        assert!(version(Some("\"a\""), None).is_exact());
        assert!(version(None, Some("Mon, 02 Nov 2026 10:00:00 GMT")).is_exact());
        assert!(!version(Some("W/\"a\""), None).is_exact());
        assert!(!version(None, None).is_exact());
    }
}

//! What is remembered about installed networks, in the folder of networks.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

use serde::{Deserialize, Serialize};

use super::catalogue::CatalogueEntry;
use super::error::NnError;
use ostra_core::disk;

/// File of the records, in the folder of networks.
const RECORDS: &str = "records.toml";
/// Maximum size of that file; a larger one is damaged.
const MAX_BYTES: u64 = 16 << 20;

/// What is remembered about one entry of the catalogue.
#[derive(Debug, Clone, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct EntryRecord {
    /// Name of the installed variant.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub variant: Option<String>,
    /// Licence that the user accepted.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub accepted_licence: Option<String>,
    /// Result of the last test of the installed files.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub test: Option<TestRecord>,
    /// Digests of downloads for which the catalogue has none, by address.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub first_downloads: BTreeMap<String, String>,
}

/// Result of a test.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(super) struct TestRecord {
    /// Sizes and times of the tested files. The result does not hold for others.
    pub files: Vec<String>,
    /// What was wrong with the answers; `None` if they were right.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub failure: Option<String>,
}

/// Returns the record of an entry.
pub(super) fn record_of(folder: &Path, name: &str) -> Result<EntryRecord, NnError> {
    Ok(read(folder)?.remove(name).unwrap_or_default())
}

/// Returns whether the user has accepted the current licence of a network that asks for it.
pub(super) fn has_accepted(folder: &Path, entry: &CatalogueEntry) -> Result<bool, NnError> {
    let accepted = record_of(folder, &entry.name)?.accepted_licence;
    Ok(accepted.as_ref() == Some(&entry.licence))
}

/// Changes the record of an entry.
pub(super) fn change_record(
    folder: &Path,
    name: &str,
    change: impl FnOnce(&mut EntryRecord),
) -> Result<(), NnError> {
    let before = read(folder)?;
    let mut records = before.clone();
    let record = records.entry(name.to_owned()).or_default();
    change(record);
    if *record == EntryRecord::default() {
        records.remove(name);
    }
    if records == before {
        return Ok(());
    }
    let path = folder.join(RECORDS);
    let text = toml::to_string(&records)
        .map_err(|error| NnError::Request(format!("{}: {error}", path.display())))?;
    fs::create_dir_all(folder)
        .and_then(|()| disk::write(&path, text.as_bytes()))
        .map_err(|reason| NnError::Io { path, reason })
}

/// Identifies the current content of files by their sizes and times.
pub(super) fn stamps(files: &[PathBuf]) -> Vec<String> {
    files
        .iter()
        .map(|path| {
            let about = fs::metadata(path).ok();
            let bytes = about.as_ref().map_or(0, fs::Metadata::len);
            let modified = about
                .and_then(|about| about.modified().ok())
                .and_then(|time| time.duration_since(UNIX_EPOCH).ok())
                .map_or(0, |time| time.as_nanos());
            format!("{bytes} {modified}")
        })
        .collect()
}

fn read(folder: &Path) -> Result<BTreeMap<String, EntryRecord>, NnError> {
    let path = folder.join(RECORDS);
    match disk::read_text_up_to(&path, MAX_BYTES) {
        Ok(text) => toml::from_str(&text).map_err(|error| {
            NnError::Request(format!(
                "{}: cannot be parsed ({}); delete it",
                path.display(),
                error.message()
            ))
        }),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(BTreeMap::new()),
        Err(reason) => Err(NnError::Io { path, reason }),
    }
}

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

use super::error::NnError;
use ostra_core::disk;

/// File with the digests of added files by name, in the folder of networks.
const RECORDS: &str = "digests.toml";
/// Maximum size of that file; a larger one is damaged.
const MAX_BYTES: u64 = 16 << 20;

/// Returns the digests of files.
pub(super) fn digests(files: &[PathBuf]) -> Result<Vec<String>, NnError> {
    files.iter().map(|path| digest(path)).collect()
}

/// Records the digests of added files.
pub(super) fn record(
    folder: &Path,
    files: &[PathBuf],
    digests: Vec<String>,
) -> Result<(), NnError> {
    let mut records = read(folder)?;
    records.extend(files.iter().map(|path| name(path)).zip(digests));
    write(folder, &records)
}

/// Forgets the digests of deleted files.
pub(super) fn forget(folder: &Path, names: &[String]) -> Result<(), NnError> {
    let mut records = read(folder)?;
    let count = records.len();
    records.retain(|name, _| !names.contains(name));
    if records.len() == count {
        return Ok(());
    }
    write(folder, &records)
}

fn write(folder: &Path, records: &BTreeMap<String, String>) -> Result<(), NnError> {
    let path = folder.join(RECORDS);
    let text = toml::to_string(records)
        .map_err(|error| NnError::Request(format!("{}: {error}", path.display())))?;
    disk::write(&path, text.as_bytes()).map_err(|reason| NnError::Io { path, reason })
}

/// Rejects a file that has changed since it was added; unrecorded files are accepted.
pub(super) fn compare(folder: &Path, path: &Path) -> Result<(), NnError> {
    let Some(expected) = read(folder)?.remove(&name(path)) else {
        return Ok(());
    };
    let found = digest(path)?;
    if found == expected {
        Ok(())
    } else {
        Err(NnError::Changed {
            path: path.to_owned(),
            expected,
            found,
        })
    }
}

fn read(folder: &Path) -> Result<BTreeMap<String, String>, NnError> {
    let path = folder.join(RECORDS);
    match disk::read_text_up_to(&path, MAX_BYTES) {
        Ok(text) => toml::from_str(&text)
            .map_err(|error| NnError::Request(format!("{}: {error}; delete it", path.display()))),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(BTreeMap::new()),
        Err(reason) => Err(NnError::Io { path, reason }),
    }
}

fn digest(path: &Path) -> Result<String, NnError> {
    sha256(path).map_err(|reason| NnError::Io {
        path: path.to_owned(),
        reason,
    })
}

fn name(path: &Path) -> String {
    path.file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

/// Returns the SHA-256 of a file's content in lower-case hexadecimal.
///
/// # Errors
/// Fails if the file cannot be read.
pub fn sha256(path: &Path) -> std::io::Result<String> {
    let mut file = File::open(path)?;
    let mut hasher = Sha256::new();
    let mut block = vec![0; 1 << 16];
    loop {
        match file.read(&mut block)? {
            0 => break,
            read => hasher.update(&block[..read]),
        }
    }
    Ok(hasher
        .finalize()
        .iter()
        .map(|byte| format!("{byte:02x}"))
        .collect())
}

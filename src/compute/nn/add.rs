use std::fs::{self, File};
use std::path::{Path, PathBuf};

use super::catalogue::{Catalogue, CatalogueEntry, NetworkFile};
use super::digests::{digests, record, sha256};
use super::error::NnError;
use super::installed::text;
use super::network::Network;
use super::runtime::{Runtime, whole};
use ostra_core::disk::{self, AtomicFile};

/// A file that was copied into the folder of networks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Added {
    /// Path of the copy.
    pub path: PathBuf,
    /// How the file was verified.
    pub proof: Verification,
}

/// How an added file was verified.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Verification {
    /// It loads and has the expected inputs and outputs.
    Fits,
    /// It loads; its expected inputs and outputs are not known.
    Loads,
    /// It has a known digest; it was not loaded.
    Known,
    /// It could not be verified, for this reason.
    None(String),
}

/// Verifies the files of a network (or the library of ONNX Runtime) and copies them.
///
/// The files are verified by loading, or by their digest if there is no ONNX Runtime. None is put
/// into `folder` before all are verified and copied. Instead of the files, `files` may contain a
/// folder that has them under the catalogue's names.
///
/// # Errors
/// Fails if the name is unknown or the number of files is wrong. Also fails if a file does not
/// load, has another interface or cannot be copied.
pub fn add(
    catalogue: &Catalogue,
    folder: &Path,
    name: &str,
    files: &[PathBuf],
) -> Result<Vec<Added>, NnError> {
    let entry = catalogue.entry(name)?;
    let names = entry.file_names();
    let in_folder = |folder: &PathBuf| {
        names
            .iter()
            .map(|name| folder.join(name))
            .collect::<Vec<_>>()
    };
    let within = match files {
        [folder] if folder.is_dir() => Some(in_folder(folder)),
        _ => None,
    };
    let files = within.as_deref().unwrap_or(files);
    if names.len() != files.len() {
        let wanted = names.join(", ");
        return Err(NnError::Request(format!(
            "`{name}` takes {} in this order: {wanted}",
            count(names.len())
        )));
    }
    let proofs = if entry.is_library() {
        files
            .iter()
            .map(|path| prove_library(path))
            .collect::<Result<Vec<_>, _>>()?
    } else {
        prove_networks(entry, files)?
    };
    let targets: Vec<PathBuf> = names.iter().map(|name| folder.join(name)).collect();
    let digests = digests(files)?;
    place(folder, files, &targets)?;
    record(folder, &targets, digests)?;
    Ok(targets
        .into_iter()
        .zip(proofs)
        .map(|(path, proof)| Added { path, proof })
        .collect())
}

fn count(files: usize) -> String {
    if files == 1 {
        "one file,".to_owned()
    } else {
        format!("{files} files")
    }
}

fn prove_library(path: &Path) -> Result<Verification, NnError> {
    readable(path)?;
    if let Some(other) = Runtime::loaded().filter(|runtime| runtime.path() != whole(path)) {
        return Ok(Verification::None(format!(
            "{} is in use until the program is started again",
            other.path().display()
        )));
    }
    Runtime::open(path).map(|_| Verification::Loads)
}

fn prove_networks(entry: &CatalogueEntry, paths: &[PathBuf]) -> Result<Vec<Verification>, NnError> {
    paths.iter().try_for_each(|path| readable(path))?;
    let pairs = entry.files().iter().zip(paths);
    let prove = |(file, path): (&NetworkFile, &PathBuf)| match Runtime::find() {
        _ if file.is_text => text(path).map(|_| Verification::Loads),
        Ok(runtime) => prove_by_loading(&runtime, file, path),
        Err(error) => prove_by_digest(file, path, &error),
    };
    pairs.map(prove).collect()
}

fn prove_by_loading(
    runtime: &Runtime,
    file: &NetworkFile,
    path: &Path,
) -> Result<Verification, NnError> {
    let expected = file.signature();
    Network::load(runtime, path, expected.as_ref())?;
    Ok(if expected.is_some() {
        Verification::Fits
    } else {
        Verification::Loads
    })
}

fn prove_by_digest(
    file: &NetworkFile,
    path: &Path,
    why: &NnError,
) -> Result<Verification, NnError> {
    let Some(expected) = &file.sha256 else {
        return Ok(Verification::None(why.to_string()));
    };
    let found = sha256(path).map_err(|reason| NnError::Io {
        path: path.to_owned(),
        reason,
    })?;
    if found == *expected || file.other_sha256.contains(&found) {
        return Ok(Verification::Known);
    }
    Err(NnError::Digest {
        path: path.to_owned(),
        expected: expected.clone(),
        found,
    })
}

fn readable(path: &Path) -> Result<(), NnError> {
    File::open(path).map(drop).map_err(|reason| NnError::Io {
        path: path.to_owned(),
        reason,
    })
}

/// Copies all files before any of them replaces an existing one.
fn place(folder: &Path, files: &[PathBuf], targets: &[PathBuf]) -> Result<(), NnError> {
    let failed = |path: &Path| {
        let path = path.to_owned();
        move |reason| NnError::Io { path, reason }
    };
    fs::create_dir_all(folder).map_err(failed(folder))?;
    disk::remove_leftovers(folder, false);
    let mut copies = Vec::new();
    for (from, to) in files.iter().zip(targets) {
        let mut source = File::open(from).map_err(failed(from))?;
        let mut copy = AtomicFile::create(to).map_err(failed(to))?;
        std::io::copy(&mut source, copy.as_file()).map_err(failed(to))?;
        copies.push((copy, to));
    }
    copies
        .into_iter()
        .try_for_each(|(copy, to)| copy.commit().map_err(failed(to)))
}

use std::path::{Path, PathBuf};

use super::catalogue::{Catalogue, CatalogueEntry, NetworkFile};
use super::digests::compare;
use super::error::NnError;
use super::network::Network;
use super::runtime::{Runtime, library_name};
use super::tensor::Signature;

/// A network of the catalogue, with its files if it is installed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ModelStatus {
    /// Name on the command line.
    pub name: String,
    /// Purpose.
    pub purpose: String,
    /// Licence of the weights.
    pub licence: String,
    /// Where to get it.
    pub source: String,
    /// Names of its files, in the order of the catalogue.
    pub files: Vec<String>,
    /// Whether every file has a download address.
    pub has_address: bool,
    /// The installed files, if all of them exist.
    pub installed: Option<Installed>,
}

/// Installed files of a network.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Installed {
    /// Paths in the order of the catalogue.
    pub paths: Vec<PathBuf>,
    /// Total size in bytes.
    pub bytes: u64,
}

/// Result of loading one installed file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CheckedFile {
    /// The file.
    pub path: PathBuf,
    /// Inputs and outputs; `None` for ONNX Runtime itself and for text files.
    pub signature: Option<Signature>,
    /// Whether these were compared with the expected ones.
    pub is_compared: bool,
}

impl CatalogueEntry {
    /// Returns the entry's files in `folder`; `None` if one is missing.
    #[must_use]
    pub fn installed(&self, folder: &Path) -> Option<Installed> {
        let paths: Vec<PathBuf> = self
            .file_names()
            .iter()
            .map(|name| folder.join(name))
            .collect();
        let sizes = paths.iter().map(|path| {
            std::fs::metadata(path)
                .ok()
                .filter(std::fs::Metadata::is_file)
        });
        let bytes = sizes
            .map(|size| size.map(|size| size.len()))
            .sum::<Option<u64>>()?;
        Some(Installed { paths, bytes })
    }
}

/// Lists every entry and whether it is installed in `folder`.
#[must_use]
pub fn list(catalogue: &Catalogue, folder: &Path) -> Vec<ModelStatus> {
    let status = |entry: &CatalogueEntry| ModelStatus {
        name: entry.name.clone(),
        purpose: entry.purpose.clone(),
        licence: entry.licence.clone(),
        source: entry.source.clone(),
        files: entry.file_names(),
        has_address: entry.has_address(),
        installed: entry.installed(folder),
    };
    catalogue.entries().iter().map(status).collect()
}

/// Loads the network installed under `name` and reports its inputs and outputs.
///
/// # Errors
/// Fails if the network is unknown, not installed, does not load or has another interface.
pub fn check(
    catalogue: &Catalogue,
    folder: &Path,
    name: &str,
) -> Result<Vec<CheckedFile>, NnError> {
    let entry = catalogue.entry(name)?;
    if entry.is_library() {
        let own = folder.join(library_name());
        if own.exists() {
            compare(folder, &own)?;
        }
        let path = Runtime::find()?.path().to_owned();
        return Ok(vec![CheckedFile {
            path,
            signature: None,
            is_compared: false,
        }]);
    }
    let installed = entry
        .installed(folder)
        .ok_or_else(|| entry.missing(folder))?;
    let runtime = Runtime::find()?;
    let load = |(file, path): (&NetworkFile, PathBuf)| {
        compare(folder, &path)?;
        if file.is_text {
            text(&path)?;
            return Ok(CheckedFile {
                path,
                signature: None,
                is_compared: false,
            });
        }
        let expected = file.signature();
        let network = Network::load(&runtime, &path, expected.as_ref())?;
        Ok(CheckedFile {
            path,
            signature: Some(network.signature().clone()),
            is_compared: expected.is_some(),
        })
    };
    entry
        .files()
        .iter()
        .zip(installed.paths)
        .map(load)
        .collect()
}

/// Loads the networks installed in `folder` under `name`, one per file that is not text.
///
/// # Errors
/// As [`check`].
pub fn load(folder: &Path, name: &str) -> Result<Vec<Network>, NnError> {
    let catalogue = Catalogue::bundled()?;
    let entry = catalogue.entry(name)?;
    let installed = entry
        .installed(folder)
        .ok_or_else(|| entry.missing(folder))?;
    let runtime = Runtime::find()?;
    let networks = entry
        .files()
        .iter()
        .zip(&installed.paths)
        .filter(|(file, _)| !file.is_text);
    networks
        .map(|(file, path)| Network::load(&runtime, path, file.signature().as_ref()))
        .collect()
}

/// Reads the text files installed in `folder` under `name`.
///
/// # Errors
/// Fails if the name is unknown, or if a file is missing or is not UTF-8 text.
pub fn load_text(folder: &Path, name: &str) -> Result<Vec<String>, NnError> {
    let catalogue = Catalogue::bundled()?;
    let entry = catalogue.entry(name)?;
    let installed = entry
        .installed(folder)
        .ok_or_else(|| entry.missing(folder))?;
    let texts = entry
        .files()
        .iter()
        .zip(&installed.paths)
        .filter(|(file, _)| file.is_text);
    texts.map(|(_, path)| text(path)).collect()
}

/// Reads a UTF-8 text file.
pub(super) fn text(path: &Path) -> Result<String, NnError> {
    std::fs::read_to_string(path).map_err(|reason| NnError::Io {
        path: path.to_owned(),
        reason,
    })
}

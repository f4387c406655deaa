use std::path::{Path, PathBuf};

use super::catalogue::{Catalogue, Entry, NetworkFile};
use super::digests::compare;
use super::error::NnError;
use super::network::Network;
use super::runtime::{Runtime, library_name};
use super::tensor::Signature;

/// One line of the list of networks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Row {
    /// What it is called on the command line.
    pub name: String,
    /// What it is good for.
    pub purpose: String,
    /// Licence of the weights.
    pub licence: String,
    /// Where it can be had.
    pub source: String,
    /// Names of its files, in the order in which they are given.
    pub files: Vec<String>,
    /// Whether [`super::add`] knows an address of every file.
    pub has_address: bool,
    /// Its files, where all of them are there.
    pub installed: Option<Installed>,
}

/// Files of a network that are there.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Installed {
    /// In the catalogue's order.
    pub paths: Vec<PathBuf>,
    /// All together.
    pub bytes: u64,
}

/// What loading one installed file showed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CheckedFile {
    /// The file.
    pub path: PathBuf,
    /// What it takes and gives; `None` for ONNX Runtime itself and for text.
    pub signature: Option<Signature>,
    /// Whether that was held against what the program expects.
    pub is_compared: bool,
}

impl Entry {
    /// The entry's files in `folder`; `None` where one is missing.
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

/// Every entry and whether it is in `folder`.
#[must_use]
pub fn list(catalogue: &Catalogue, folder: &Path) -> Vec<Row> {
    let row = |entry: &Entry| Row {
        name: entry.name.clone(),
        purpose: entry.purpose.clone(),
        licence: entry.licence.clone(),
        source: entry.source.clone(),
        files: entry.file_names(),
        has_address: entry.has_address(),
        installed: entry.installed(folder),
    };
    catalogue.entries().iter().map(row).collect()
}

/// Loads the network installed under `name` and reports its inputs and outputs.
///
/// # Errors
/// When it is unknown, not installed, does not load or has another interface.
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

/// Loads the networks that `folder` holds under `name`, one per file that is not text.
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

/// Reads the text files that `folder` holds under `name`.
///
/// # Errors
/// When the name is unknown, a file of it is missing or no text in UTF-8.
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

/// A file of text in UTF-8.
pub(super) fn text(path: &Path) -> Result<String, NnError> {
    std::fs::read_to_string(path).map_err(|reason| NnError::Io {
        path: path.to_owned(),
        reason,
    })
}

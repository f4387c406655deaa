use std::path::{Path, PathBuf};

use serde::Serialize;

use super::catalogue::{Catalogue, CatalogueEntry, NetworkVariant};
use super::digests::compare;
use super::error::NnError;
use super::fitting::{candidates, fit};
use super::network::Network;
use super::network_file::{Dialect, FileKind, read_text};
use super::records::{TestRecord, change_record, has_accepted, record_of, stamps};
use super::runtime::{Runtime, library_name};
use super::runtime_package::RuntimePackage;
use super::tensor::Signature;

/// A network of the catalogue, with its files if it is installed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ModelStatus {
    /// Name on the command line.
    pub name: String,
    /// Purpose.
    pub purpose: String,
    /// Licence of the weights.
    pub licence: String,
    /// Address of the licence if it has to be accepted before a download, and is not yet.
    pub licence_to_accept: Option<String>,
    /// Where to get it.
    pub source: String,
    /// Names of its files, in the order of the catalogue.
    pub files: Vec<String>,
    /// Whether every file has a download address.
    pub has_address: bool,
    /// Server of the preferred download address, if there is one.
    pub server: Option<String>,
    /// Number of bytes to download, if known.
    pub download_bytes: Option<u64>,
    /// Estimated number of bytes to download, if the exact one is not known.
    pub about_bytes: Option<u64>,
    /// Variants that can be downloaded, the recommended one first; none if there is only one.
    pub variants: Vec<VariantStatus>,
    /// The installed files, if all of them exist.
    pub installed: Option<Installed>,
    /// Name of the installed variant, if there are several.
    pub installed_variant: Option<String>,
    /// Result of the last test of the installed files, if there was one.
    pub tested: Option<TestResult>,
}

/// A variant of a network that can be downloaded.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct VariantStatus {
    /// Name on the command line.
    pub name: String,
    /// What distinguishes it.
    pub summary: String,
    /// Number of bytes to download, if known.
    pub download_bytes: Option<u64>,
    /// Estimated number of bytes to download, if the exact one is not known.
    pub about_bytes: Option<u64>,
    /// Least memory that it needs, in MB, if known.
    pub memory_mb: Option<u64>,
}

impl ModelStatus {
    /// Returns the size of the download as text, such as "45.8 MB" or "about 130 MB".
    #[must_use]
    pub fn download_text(&self) -> Option<String> {
        size_text(self.download_bytes, self.about_bytes)
    }
}

impl VariantStatus {
    /// Returns the size of the download as text, such as "45.8 MB" or "about 130 MB".
    #[must_use]
    pub fn download_text(&self) -> Option<String> {
        size_text(self.download_bytes, self.about_bytes)
    }
}

fn size_text(exact: Option<u64>, about: Option<u64>) -> Option<String> {
    let exact = exact.map(|bytes| format!("{:.1} MB", bytes as f64 / 1e6));
    exact.or_else(|| Some(format!("about {} MB", about?.div_ceil(1_000_000))))
}

/// Result of a test with a known answer.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum TestResult {
    /// The answers were right.
    Passed,
    /// The network gives other answers.
    Failed(String),
}

/// Installed files of a network.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
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

/// Loaded networks and how to feed them.
#[derive(Debug)]
pub struct LoadedNetworks {
    /// Their interface, if several are in use.
    pub dialect: Option<Dialect>,
    /// One network per file that is not text or data.
    pub networks: Vec<Network>,
}

impl Installed {
    /// Returns texts that identify the current content of the files, by their sizes and times.
    #[must_use]
    pub fn stamps(&self) -> Vec<String> {
        stamps(&self.paths)
    }
}

impl CatalogueEntry {
    /// Returns the entry's files in `folder`; `None` if one is missing.
    #[must_use]
    pub fn installed(&self, folder: &Path) -> Option<Installed> {
        if self.is_library() {
            return files_in(folder, &self.file_names());
        }
        let recorded = record_of(folder, &self.name).ok().unwrap_or_default();
        let mut variants: Vec<&NetworkVariant> = self.variants().iter().collect();
        variants.sort_by_key(|variant| Some(&variant.name) != recorded.variant.as_ref());
        variants.into_iter().find_map(|variant| {
            let names: Vec<String> = variant.files.iter().map(|file| file.name.clone()).collect();
            files_in(folder, &names)
        })
    }

    /// Returns the result of the last test of the installed files, if there was one.
    #[must_use]
    pub fn tested(&self, folder: &Path) -> Option<TestResult> {
        let installed = self.installed(folder)?;
        let record = record_of(folder, &self.name).ok()?.test?;
        let is_current = record.files == installed.stamps();
        is_current.then(|| {
            record
                .failure
                .map_or(TestResult::Passed, TestResult::Failed)
        })
    }

    /// Returns whether the entry's files are in `folder` and did not fail their last test.
    #[must_use]
    pub fn is_usable(&self, folder: &Path) -> bool {
        self.installed(folder).is_some()
            && !matches!(self.tested(folder), Some(TestResult::Failed(_)))
    }
}

fn files_in(folder: &Path, names: &[String]) -> Option<Installed> {
    let paths: Vec<PathBuf> = names.iter().map(|name| folder.join(name)).collect();
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

/// Lists every entry and whether it is installed in `folder`.
#[must_use]
pub fn list(catalogue: &Catalogue, folder: &Path) -> Vec<ModelStatus> {
    let entries = catalogue.entries().iter();
    entries.map(|entry| status(entry, folder)).collect()
}

fn status(entry: &CatalogueEntry, folder: &Path) -> ModelStatus {
    let available = || {
        entry
            .variants()
            .iter()
            .filter(|variant| variant.has_address())
    };
    let package = RuntimePackage::for_this_system().ok();
    let library = package
        .filter(|_| entry.is_library())
        .map(RuntimePackage::file);
    let download_bytes = match &library {
        Some(library) => library.download_bytes(),
        None => available().next().and_then(NetworkVariant::download_bytes),
    };
    let recommended = available().next().and_then(|variant| variant.files.first());
    let address = library
        .as_ref()
        .or(recommended)
        .and_then(|file| file.addresses.first());
    let variants = available()
        .filter(|variant| !variant.name.is_empty())
        .map(|variant| VariantStatus {
            name: variant.name.clone(),
            summary: variant.summary.clone(),
            download_bytes: variant.download_bytes(),
            about_bytes: variant.about_bytes(),
            memory_mb: variant.memory_mb,
        });
    let must_accept = |_: &String| !has_accepted(folder, entry).unwrap_or(false);
    let installed = entry.installed(folder);
    ModelStatus {
        name: entry.name.clone(),
        purpose: entry.purpose.clone(),
        licence: entry.licence.clone(),
        licence_to_accept: entry.accept_licence.clone().filter(must_accept),
        source: entry.source.clone(),
        files: entry.file_names(),
        has_address: entry.has_address(),
        server: address.map(|address| address.server().to_owned()),
        download_bytes,
        about_bytes: available().next().and_then(NetworkVariant::about_bytes),
        variants: variants.collect(),
        installed_variant: installed
            .as_ref()
            .and_then(|_| record_of(folder, &entry.name).ok()?.variant),
        tested: entry.tested(folder),
        installed,
    }
}

/// Remembers the result of a test of the installed files.
///
/// # Errors
/// Fails if the network is unknown or not installed, or the record cannot be written.
pub fn record_test(
    catalogue: &Catalogue,
    folder: &Path,
    name: &str,
    result: &TestResult,
) -> Result<(), NnError> {
    let entry = catalogue.entry(name)?;
    let installed = entry
        .installed(folder)
        .ok_or_else(|| entry.missing(folder))?;
    change_record(folder, name, |record| {
        record.test = Some(TestRecord {
            files: installed.stamps(),
            failure: match result {
                TestResult::Passed => None,
                TestResult::Failed(what) => Some(what.clone()),
            },
        });
    })
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
    for path in &installed.paths {
        compare(folder, path)?;
    }
    let runtime = Runtime::find()?;
    let recorded = record_of(folder, name)?.variant;
    let candidates = candidates(entry, recorded.as_deref(), installed.paths.len());
    let fitting = fit(&runtime, &candidates, &installed.paths)?;
    let mut networks = fitting.networks.into_iter();
    let files = fitting.variant.files.iter().zip(installed.paths);
    files
        .map(|(file, path)| {
            let network = match file.kind {
                FileKind::Network => networks.next(),
                FileKind::Text => read_text(&path).map(|_| None)?,
                FileKind::Data => None,
            };
            Ok(CheckedFile {
                path,
                is_compared: network.is_some() && file.signature.is_some(),
                signature: network.map(|network| network.signature().clone()),
            })
        })
        .collect()
}

/// Loads the networks installed in `folder` under `name`, one per file that is not text or data.
///
/// # Errors
/// As [`check`].
pub fn load(folder: &Path, name: &str) -> Result<Vec<Network>, NnError> {
    Ok(load_with_dialect(folder, name)?.networks)
}

/// As [`load`], with the interface of the networks.
///
/// # Errors
/// As [`check`].
pub fn load_with_dialect(folder: &Path, name: &str) -> Result<LoadedNetworks, NnError> {
    let catalogue = Catalogue::load()?;
    let entry = catalogue.entry(name)?;
    let installed = entry
        .installed(folder)
        .ok_or_else(|| entry.missing(folder))?;
    let runtime = Runtime::find()?;
    let recorded = record_of(folder, name)?.variant;
    let candidates = candidates(entry, recorded.as_deref(), installed.paths.len());
    let fitting = fit(&runtime, &candidates, &installed.paths)?;
    Ok(LoadedNetworks {
        dialect: fitting.variant.dialect,
        networks: fitting.networks,
    })
}

/// Reads the text files installed in `folder` under `name`.
///
/// # Errors
/// Fails if the name is unknown, or if a file is missing or is not UTF-8 text.
pub fn load_text(folder: &Path, name: &str) -> Result<Vec<String>, NnError> {
    let catalogue = Catalogue::load()?;
    let entry = catalogue.entry(name)?;
    let installed = entry
        .installed(folder)
        .ok_or_else(|| entry.missing(folder))?;
    let texts = entry
        .files()
        .iter()
        .zip(&installed.paths)
        .filter(|(file, _)| file.kind == FileKind::Text);
    texts.map(|(_, path)| read_text(path)).collect()
}

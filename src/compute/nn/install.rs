use std::fs;
use std::path::{Path, PathBuf};

use super::add::{Added, GivenFiles, Placing, add_files};
use super::catalogue::{Catalogue, CatalogueEntry, NetworkVariant};
use super::digests::forget;
use super::error::NnError;
use super::network_file::NetworkFile;
use super::obtain::{Fetched, Supply};
use super::records::{EntryRecord, change_record, has_accepted, record_of};
use super::runtime_package::RuntimePackage;
use super::unfinished::downloaded_bytes;

/// Options of [`install`].
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct InstallOptions {
    /// Name of the variant; `None` takes the recommended one.
    pub variant: Option<String>,
    /// Folder of downloaded files to take instead of downloading.
    pub from: Option<PathBuf>,
    /// Whether the user accepts the licence. This is remembered.
    pub accept_licence: bool,
}

/// Subfolder of the folder of networks for unfinished downloads.
const UNDER_WAY: &str = "downloads";
/// Space that must remain free on the disk, in bytes.
const SPARE_BYTES: u64 = 100_000_000;

/// Downloads the files of a network (or the library of ONNX Runtime) and adds them.
///
/// `progress` receives the progress and returns whether to continue. The next call continues a
/// stopped or interrupted download.
///
/// # Errors
/// Fails if the name is unknown, or if the network has no download address (the message states how
/// to get it). Fails if the licence has to be accepted first, or the disk has not enough space. Also
/// fails if a download fails or has a wrong digest, and as [`super::add`].
pub fn install(
    catalogue: &Catalogue,
    folder: &Path,
    name: &str,
    options: &InstallOptions,
    progress: &mut dyn FnMut(Fetched<'_>) -> bool,
) -> Result<Vec<Added>, NnError> {
    let entry = catalogue.entry(name)?;
    let (variant, files) = wanted(entry, options)?;
    check_licence(folder, entry, options)?;
    let downloads = folder.join(UNDER_WAY).join(name);
    check_space(folder, &downloads, entry, &files)?;
    fs::create_dir_all(&downloads).map_err(|reason| NnError::Io {
        path: downloads.clone(),
        reason,
    })?;
    let record = record_of(folder, name)?;
    let supply = Supply {
        network: name,
        licence: &entry.licence,
        downloads: &downloads,
        from: options.from.as_deref(),
        record: &record,
    };
    let mut paths = Vec::new();
    let mut first_digests = Vec::new();
    for file in &files {
        let (path, first) = supply.obtain(file, progress)?;
        paths.push(path);
        first_digests.extend(first);
    }
    let given = GivenFiles {
        paths: &paths,
        variant: variant.map(|variant| variant.name.as_str()),
        placing: Placing::Move,
    };
    let added = add_files(entry, folder, &given);
    // This also removes rejected files, so that they are not reused. Leftovers do no harm.
    let _ = fs::remove_dir_all(&downloads);
    let added = added?;
    change_record(folder, name, |record| {
        for first in first_digests {
            record.first_downloads.insert(first.url, first.sha256);
        }
    })?;
    Ok(added)
}

/// Deletes the files of a network, and what was left of its downloads. Returns the deleted files.
///
/// An accepted licence is remembered.
///
/// # Errors
/// Fails if the name is unknown, nothing is installed, or a file cannot be deleted.
pub fn remove(catalogue: &Catalogue, folder: &Path, name: &str) -> Result<Vec<PathBuf>, NnError> {
    let entry = catalogue.entry(name)?;
    let mut names = entry.file_names();
    let all = entry.variants().iter().flat_map(|variant| &variant.files);
    names.extend(all.map(|file| file.name.clone()));
    names.sort();
    names.dedup();
    let downloads = folder.join(UNDER_WAY).join(name);
    let files: Vec<PathBuf> = names
        .iter()
        .map(|name| folder.join(name))
        .filter(|path| path.is_file())
        .collect();
    if files.is_empty() && !downloads.exists() {
        return Err(NnError::Request(format!(
            "`{name}` is not installed ({})",
            folder.display()
        )));
    }
    for path in &files {
        fs::remove_file(path).map_err(|reason| NnError::Io {
            path: path.clone(),
            reason,
        })?;
    }
    if downloads.exists() {
        fs::remove_dir_all(&downloads).map_err(|reason| NnError::Io {
            path: downloads.clone(),
            reason,
        })?;
    }
    forget(folder, &names)?;
    change_record(folder, name, |record| {
        *record = EntryRecord {
            accepted_licence: record.accepted_licence.take(),
            ..EntryRecord::default()
        };
    })?;
    Ok(files)
}

/// Returns the variant to install and its files.
fn wanted<'a>(
    entry: &'a CatalogueEntry,
    options: &InstallOptions,
) -> Result<(Option<&'a NetworkVariant>, Vec<NetworkFile>), NnError> {
    let named: Vec<&str> = entry
        .variants()
        .iter()
        .filter(|variant| variant.has_address() && !variant.name.is_empty())
        .map(|variant| variant.name.as_str())
        .collect();
    let found = match options.variant.as_deref() {
        Some(name) => {
            let found = entry.variant(name).filter(|_| named.contains(&name));
            if found.is_none() {
                let choice = if named.is_empty() {
                    "it has no variants to choose from".to_owned()
                } else {
                    format!("those that can be installed are {}", named.join(", "))
                };
                return Err(NnError::Request(format!(
                    "`{}` has no variant `{name}`; {choice}",
                    entry.name
                )));
            }
            found
        }
        None => entry
            .variants()
            .iter()
            .find(|variant| variant.has_address()),
    };
    if entry.is_library() {
        return Ok((None, vec![RuntimePackage::for_this_system()?.file()]));
    }
    let variant = found.ok_or_else(|| entry.without_address())?;
    Ok((Some(variant), variant.files.clone()))
}

/// Checks that the licence is accepted, if it must be; remembers that it was accepted now.
fn check_licence(
    folder: &Path,
    entry: &CatalogueEntry,
    options: &InstallOptions,
) -> Result<(), NnError> {
    let Some(address) = &entry.accept_licence else {
        return Ok(());
    };
    if has_accepted(folder, entry)? {
        return Ok(());
    }
    let (name, licence) = (&entry.name, &entry.licence);
    if !options.accept_licence {
        return Err(NnError::Request(format!(
            "`{name}` is under the licence {licence}, which you have to accept first; read {address} and run \
             `ostra models install {name} --accept-licence`"
        )));
    }
    change_record(folder, name, |record| {
        record.accepted_licence = Some(licence.clone());
    })
}

/// Checks that the disk has space for what is not downloaded yet.
fn check_space(
    folder: &Path,
    downloads: &Path,
    entry: &CatalogueEntry,
    files: &[NetworkFile],
) -> Result<(), NnError> {
    let mut archives = Vec::new();
    let mut needed = 0u64;
    for file in files {
        needed = needed.saturating_add(file.bytes.unwrap_or(0));
        let first = file.addresses.first();
        if let Some(address) = first.filter(|address| address.is_packed())
            && !archives.contains(&&address.url)
        {
            archives.push(&address.url);
            needed = needed.saturating_add(address.bytes.unwrap_or(0));
        }
    }
    let needed = needed.saturating_sub(downloaded_bytes(downloads));
    // The folder may not exist yet; the closest existing one is on the same disk.
    let existing = folder.ancestors().find(|path| path.is_dir());
    let free = existing.and_then(|path| fs4::available_space(path).ok());
    match free {
        Some(free) if free < needed.saturating_add(SPARE_BYTES) => Err(NnError::Request(format!(
            "{}: `{}` needs {} MB, and this disk has {} MB free; free some space there",
            folder.display(),
            entry.name,
            needed.div_ceil(1_000_000),
            free / 1_000_000
        ))),
        _ => Ok(()),
    }
}

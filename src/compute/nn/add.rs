use std::fs::{self, File};
use std::path::{Path, PathBuf};

use super::catalogue::{Catalogue, CatalogueEntry, NetworkVariant};
use super::digests::{digests, record};
use super::error::NnError;
use super::fitting::{candidates, fit};
use super::network_file::{FileKind, NetworkFile, read_text};
use super::records::change_record;
use super::runtime::{Runtime, whole};
use ostra_core::disk::{self, AtomicFile};

/// A file that was put into the folder of networks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Added {
    /// Path of the file there.
    pub path: PathBuf,
    /// How the file was verified.
    pub proof: Verification,
    /// Its digest, lower-case hexadecimal.
    pub sha256: String,
    /// Whether the catalogue has this digest.
    pub is_known: bool,
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

/// Files to be added to a network.
pub(super) struct GivenFiles<'a> {
    pub paths: &'a [PathBuf],
    /// Variant that the files are expected to be.
    pub variant: Option<&'a str>,
    pub placing: Placing,
}

/// Whether files are kept at their place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Placing {
    Copy,
    /// The files are on the same disk as the folder of networks, and no longer needed there.
    Move,
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
    let given = GivenFiles {
        paths: within.as_deref().unwrap_or(files),
        variant: None,
        placing: Placing::Copy,
    };
    add_files(entry, folder, &given)
}

/// As [`add`], with the files of one variant or copied files.
pub(super) fn add_files(
    entry: &CatalogueEntry,
    folder: &Path,
    given: &GivenFiles<'_>,
) -> Result<Vec<Added>, NnError> {
    let paths = given.paths;
    let candidates = candidates(entry, given.variant, paths.len());
    let count_fits = if entry.is_library() {
        paths.len() == 1
    } else {
        !candidates.is_empty()
    };
    if !count_fits {
        let (name, names) = (&entry.name, entry.file_names());
        return Err(NnError::Request(format!(
            "`{name}` takes {} in this order: {}",
            count(names.len()),
            names.join(", ")
        )));
    }
    paths.iter().try_for_each(|path| readable(path))?;
    let digests = digests(paths)?;
    let (variant, proofs) = if entry.is_library() {
        let proofs = paths.iter().map(|path| prove_library(path));
        (None, proofs.collect::<Result<Vec<_>, _>>()?)
    } else {
        let (variant, proofs) = prove_networks(&candidates, paths, &digests)?;
        (Some(variant), proofs)
    };
    let names = variant.map_or_else(
        || entry.file_names(),
        |variant| {
            let names = variant.files.iter().map(|file| file.name.clone());
            names.collect()
        },
    );
    let targets: Vec<PathBuf> = names.iter().map(|name| folder.join(name)).collect();
    place(folder, paths, &targets, given.placing)?;
    record(folder, &targets, digests.clone())?;
    change_record(folder, &entry.name, |record| {
        record.variant = variant
            .map(|variant| variant.name.clone())
            .filter(|name| !name.is_empty());
        record.test = None;
    })?;
    let files = variant.map_or(&[][..], |variant| variant.files.as_slice());
    let added = targets.into_iter().zip(proofs).zip(digests).enumerate();
    Ok(added
        .map(|(at, ((path, proof), sha256))| Added {
            is_known: files.get(at).is_some_and(|file| file.knows(&sha256)),
            path,
            proof,
            sha256,
        })
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
    if let Some(other) = Runtime::loaded().filter(|runtime| runtime.path() != whole(path)) {
        return Ok(Verification::None(format!(
            "{} is in use until the program is started again",
            other.path().display()
        )));
    }
    Runtime::open(path).map(|_| Verification::Loads)
}

/// Returns the variant that the files are, and how each was verified.
///
/// Variants may have the same interface, and differ only in the precision of the weights. Then the
/// digests show which one it is.
fn prove_networks<'a>(
    candidates: &[&'a NetworkVariant],
    paths: &[PathBuf],
    digests: &[String],
) -> Result<(&'a NetworkVariant, Vec<Verification>), NnError> {
    let mut candidates = candidates.to_vec();
    // Stable: without known digests, the order stays.
    candidates.sort_by_key(|variant| !knows_all(variant, digests));
    let (variant, missing) = match Runtime::find() {
        Ok(runtime) => (fit(&runtime, &candidates, paths)?.variant, None),
        Err(error) => (by_digests(&candidates, digests), Some(error)),
    };
    let prove = |((file, path), digest): ((&NetworkFile, &PathBuf), &String)| {
        if file.kind == FileKind::Text {
            return read_text(path).map(|_| Verification::Loads);
        }
        match &missing {
            Some(error) => prove_by_digest(file, path, digest, error),
            None if file.kind == FileKind::Data => Ok(Verification::Loads),
            None if file.signature.is_some() => Ok(Verification::Fits),
            None => Ok(Verification::Loads),
        }
    };
    let files = variant.files.iter().zip(paths).zip(digests);
    Ok((variant, files.map(prove).collect::<Result<_, _>>()?))
}

/// Returns the variant with these digests, which comes first if there is one.
///
/// Otherwise, it is one whose digests are not known, or else the first one.
fn by_digests<'a>(candidates: &[&'a NetworkVariant], digests: &[String]) -> &'a NetworkVariant {
    let first = candidates[0];
    let is_unknown = |variant: &&&NetworkVariant| {
        let mut files = variant.files.iter();
        files.all(|file| file.sha256.is_none())
    };
    if knows_all(first, digests) {
        return first;
    }
    candidates.iter().find(is_unknown).copied().unwrap_or(first)
}

fn knows_all(variant: &NetworkVariant, digests: &[String]) -> bool {
    let mut files = variant.files.iter().zip(digests);
    files.all(|(file, digest)| file.knows(digest))
}

fn prove_by_digest(
    file: &NetworkFile,
    path: &Path,
    found: &str,
    why: &NnError,
) -> Result<Verification, NnError> {
    let Some(expected) = &file.sha256 else {
        return Ok(Verification::None(why.to_string()));
    };
    if file.knows(found) {
        return Ok(Verification::Known);
    }
    Err(NnError::Digest {
        path: path.to_owned(),
        expected: expected.clone(),
        found: found.to_owned(),
    })
}

fn readable(path: &Path) -> Result<(), NnError> {
    File::open(path).map(drop).map_err(|reason| NnError::Io {
        path: path.to_owned(),
        reason,
    })
}

/// Copies all files before any of them replaces an existing one.
fn place(
    folder: &Path,
    files: &[PathBuf],
    targets: &[PathBuf],
    placing: Placing,
) -> Result<(), NnError> {
    let failed = |path: &Path| {
        let path = path.to_owned();
        move |reason| NnError::Io { path, reason }
    };
    fs::create_dir_all(folder).map_err(failed(folder))?;
    disk::remove_leftovers(folder, false);
    if placing == Placing::Move {
        let pairs = files.iter().zip(targets);
        return pairs
            .into_iter()
            .try_for_each(|(from, to)| fs::rename(from, to).map_err(failed(to)));
    }
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

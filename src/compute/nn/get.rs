use std::fs;
use std::path::{Path, PathBuf};

use super::catalogue::{Catalogue, Entry, NetworkFile};
use super::digest::sha256;
use super::error::NnError;
use super::fetch::fetch;
use super::install::{Added, add};
use super::search::library_name;
use super::unzip::unzip;
use super::watched::watched;
use super::wheel::{PYTHON_VERSION, VERSION, Wheel};
use ostra_core::programs;

/// How much of a file is there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Fetched<'a> {
    /// Name of the file, or what is asked for it.
    pub what: &'a str,
    /// Bytes that are there.
    pub bytes: u64,
    /// Bytes in all, where known.
    pub of: Option<u64>,
}

/// Most bytes of a file whose length is not known.
const MAX_BYTES: u64 = 4 << 30;
/// Downloads that are under way lie here, within the folder of networks.
const UNDER_WAY: &str = "downloads";

/// Gets the files of a network (or the library of ONNX Runtime) from the net and adds them to `folder`. `told` hears how
/// far it is and whether to go on; a stopped or broken download is continued by the next call.
///
/// # Errors
/// When the name is unknown, the network has no address (says how to get it), a download fails or is another file than the
/// one that is known; as [`add`].
pub fn install(
    catalogue: &Catalogue,
    folder: &Path,
    name: &str,
    told: &mut dyn FnMut(Fetched<'_>) -> bool,
) -> Result<Vec<Added>, NnError> {
    let entry = catalogue.entry(name)?;
    let downloads = folder.join(UNDER_WAY).join(name);
    let urls = entry
        .files()
        .iter()
        .map(|file| file.url.as_deref().zip(Some(file)));
    let urls = urls
        .collect::<Option<Vec<_>>>()
        .ok_or_else(|| entry.without_address())?;
    fs::create_dir_all(&downloads).map_err(|reason| NnError::Io {
        path: downloads.clone(),
        reason,
    })?;
    let files = if entry.is_library() {
        vec![library(&downloads, told)?]
    } else {
        urls.into_iter()
            .map(|(url, file)| download(entry, file, url, &downloads, told))
            .collect::<Result<_, _>>()?
    };
    let added = add(catalogue, folder, name, &files);
    // Also what was refused, so that it is not taken for the file again; what is left there does no harm.
    let _ = fs::remove_dir_all(&downloads);
    added
}

/// One file that is fetched, and how it is recognised.
struct Wanted<'a> {
    url: &'a str,
    sha256: &'a str,
    /// Its length, where known.
    bytes: Option<u64>,
    /// What is shown for it while it is fetched.
    what: &'a str,
}

/// Gets a file of a network, which must have a known digest: what an address gives may change.
fn download(
    entry: &Entry,
    file: &NetworkFile,
    url: &str,
    downloads: &Path,
    told: &mut dyn FnMut(Fetched<'_>) -> bool,
) -> Result<PathBuf, NnError> {
    let Some(sha256) = file.sha256.as_deref() else {
        return Err(NnError::Request(format!(
            "{}: no digest of this file is known, so a download could not be verified; get it by hand and run `ostra models \
             add {}`",
            file.name, entry.name
        )));
    };
    let what = format!("{} ({})", file.name, entry.licence);
    let into = downloads.join(&file.name);
    verified(
        &Wanted {
            url,
            sha256,
            bytes: file.bytes,
            what: &what,
        },
        &into,
        told,
    )?;
    Ok(into)
}

/// Fetches a file and compares its digest; a file with another digest is deleted. Also verifies what is there already.
fn verified(
    wanted: &Wanted<'_>,
    into: &Path,
    told: &mut dyn FnMut(Fetched<'_>) -> bool,
) -> Result<(), NnError> {
    let Wanted {
        url, bytes, what, ..
    } = *wanted;
    if !into.is_file() {
        let limit = bytes.unwrap_or(MAX_BYTES);
        fetch(url, into, limit, &mut |here| {
            told(Fetched {
                what,
                bytes: here,
                of: bytes,
            })
        })?;
    }
    verify(wanted, into)
}

fn verify(wanted: &Wanted<'_>, path: &Path) -> Result<(), NnError> {
    let failed = |reason| NnError::Io {
        path: path.to_owned(),
        reason,
    };
    let found = sha256(path).map_err(failed)?;
    if found == wanted.sha256 {
        return Ok(());
    }
    fs::remove_file(path).map_err(failed)?;
    let (url, expected) = (wanted.url.to_owned(), wanted.sha256.to_owned());
    Err(NnError::WrongDownload {
        url,
        expected,
        found,
    })
}

/// ONNX Runtime's library, from its Python package: by `pip`, which knows the user's mirrors and proxies, else from its
/// address. The package is verified before it is unpacked.
fn library(
    downloads: &Path,
    told: &mut dyn FnMut(Fetched<'_>) -> bool,
) -> Result<PathBuf, NnError> {
    let wheel = Wheel::for_this_system()?;
    let what = format!("onnxruntime {VERSION}");
    let wanted = Wanted {
        url: wheel.url,
        sha256: wheel.sha256,
        bytes: Some(wheel.bytes),
        what: &what,
    };
    let into = downloads.join(wheel.file_name());
    for python in ["python3", "python"] {
        if !into.is_file() {
            let what = format!("{what} by {python} -m pip");
            by_pip(python, wheel, downloads, &mut || {
                told(Fetched {
                    what: &what,
                    bytes: 0,
                    of: None,
                })
            })?;
        }
    }
    verified(&wanted, &into, told)?;
    let library = downloads.join(library_name());
    let failed = |reason| NnError::Io {
        path: library.clone(),
        reason,
    };
    let mut file = fs::File::create(&library).map_err(failed)?;
    unzip(&into, wheel.library, &mut file).map_err(failed)?;
    Ok(library)
}

/// Lets pip download a package into `downloads`, where it can; what it downloads is not verified yet. Isolated (`-I`) and
/// run in that folder, so that no module is taken from the current folder.
fn by_pip(
    python: &str,
    wheel: &Wheel,
    downloads: &Path,
    goes_on: &mut dyn FnMut() -> bool,
) -> Result<(), NnError> {
    let Ok(mut pip) = programs::command(python) else {
        return Ok(());
    };
    pip.args([
        "-I",
        "-m",
        "pip",
        "download",
        "--quiet",
        "--disable-pip-version-check",
        "--only-binary",
        ":all:",
    ]);
    pip.args([
        "--no-deps",
        "--python-version",
        PYTHON_VERSION,
        "--platform",
        wheel.platform,
        "--dest",
    ]);
    pip.arg(downloads)
        .arg(format!("onnxruntime=={VERSION}"))
        .current_dir(downloads);
    let stopped = || NnError::Fetch {
        url: python.to_owned(),
        what: "stopped".to_owned(),
        is_stopped: true,
    };
    match goes_on().then(|| watched(&mut pip, goes_on)) {
        None | Some(Ok(None)) => Err(stopped()),
        Some(Ok(Some(ended))) if ended.is_well() => Ok(()),
        Some(_) => {
            // What it may have begun is no download; the address is tried next, and says what is wrong.
            let _ = fs::remove_file(downloads.join(wheel.file_name()));
            Ok(())
        }
    }
}

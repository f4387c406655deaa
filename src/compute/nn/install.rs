use std::fs;
use std::path::{Path, PathBuf};

use super::add::{Added, add};
use super::catalogue::{Catalogue, Entry, NetworkFile};
use super::digests::sha256;
use super::download::{fetch, watched};
use super::error::NnError;
use super::runtime::library_name;
use super::unzip::unzip;
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

/// Version of ONNX Runtime that is installed.
pub(super) const VERSION: &str = "1.31.1";

/// The Python package of ONNX Runtime for one system: a ZIP archive that holds the library.
#[derive(Debug)]
pub(super) struct Wheel {
    os: &'static str,
    arch: &'static str,
    /// The system as pip calls it.
    pub platform: &'static str,
    /// Address of the file, which holds the file's BLAKE2b digest.
    pub url: &'static str,
    pub bytes: u64,
    pub sha256: &'static str,
    /// Name of the library within the archive.
    pub library: &'static str,
}

/// Python version of the packages in [`WHEELS`]; the library in them does not depend on it.
pub(super) const PYTHON_VERSION: &str = "3.12";

/// The packages of the Python Package Index, with digests computed from the files that it served in November 2026.
const WHEELS: [Wheel; 5] = [
    Wheel {
        os: "macos",
        arch: "aarch64",
        platform: "macosx_14_0_arm64",
        url: "https://files.pythonhosted.org/packages/0e/f7/cecc0efeeea83bff2f7789ae1b80f27fa0f0210d6d9d66d1f0031a6b5e47/onnxruntime-1.31.1-cp312-cp312-macosx_14_0_arm64.whl",
        bytes: 20882125,
        sha256: "96dd2564b10ea7153ad9c207e7cd8e5917cb3ba521e0e0a62ac03486fdc8d56c",
        library: "onnxruntime/capi/libonnxruntime.1.31.1.dylib",
    },
    Wheel {
        os: "linux",
        arch: "aarch64",
        platform: "manylinux_2_28_aarch64",
        url: "https://files.pythonhosted.org/packages/ba/e4/1ed1a7a5f4702d899091fa2b976d377995250c307326ec8dc9ae6378aa13/onnxruntime-1.31.1-cp312-cp312-manylinux_2_28_aarch64.whl",
        bytes: 21420803,
        sha256: "0b9a492176886992e0e875f06bc0367e333f5fff11711a2d642e18b02f3009cc",
        library: "onnxruntime/capi/libonnxruntime.so.1.31.1",
    },
    Wheel {
        os: "linux",
        arch: "x86_64",
        platform: "manylinux_2_28_x86_64",
        url: "https://files.pythonhosted.org/packages/eb/27/c6a823bac55b2977bea2027c3ec9393a2c1002cb9a09eb40354563e02730/onnxruntime-1.31.1-cp312-cp312-manylinux_2_28_x86_64.whl",
        bytes: 23760988,
        sha256: "1f3dea47f2f0e5117c2404cea7d21fd253ae7836a3bf167a501cdfbb2600d536",
        library: "onnxruntime/capi/libonnxruntime.so.1.31.1",
    },
    Wheel {
        os: "windows",
        arch: "x86_64",
        platform: "win_amd64",
        url: "https://files.pythonhosted.org/packages/45/b2/793b4051d8dc6acb379ead9b72050f0ffa283ca49a6904add2e218b83e2e/onnxruntime-1.31.1-cp312-cp312-win_amd64.whl",
        bytes: 14888466,
        sha256: "ae8a9a351efda685cc59a66226cdefaa37a126c1d66872ca23a2de9425326130",
        library: "onnxruntime/capi/onnxruntime.dll",
    },
    Wheel {
        os: "windows",
        arch: "aarch64",
        platform: "win_arm64",
        url: "https://files.pythonhosted.org/packages/ed/72/09d635ab4b6137d8ac63d4911a37dad8b1ef15a77d20b65d7ed40fdca012/onnxruntime-1.31.1-cp312-cp312-win_arm64.whl",
        bytes: 14740724,
        sha256: "fe8b9ac1ae8e894e12c47ee82e4f6dfc1835768133687257866469fda80d0bf1",
        library: "onnxruntime/capi/onnxruntime.dll",
    },
];

impl Wheel {
    /// The package for this system.
    ///
    /// # Errors
    /// [`NnError::Request`] where none is known; says what to do instead.
    pub fn for_this_system() -> Result<&'static Self, NnError> {
        let (os, arch) = (std::env::consts::OS, std::env::consts::ARCH);
        WHEELS.iter().find(|wheel| (wheel.os, wheel.arch) == (os, arch)).ok_or_else(|| {
            NnError::Request(format!(
                "no verified file of ONNX Runtime is known for {os} on {arch}; install ONNX Runtime 1.24 or newer by other \
                 means and set ORT_DYLIB_PATH to its library, or run `ostra models add onnxruntime FILE`"
            ))
        })
    }

    /// Name of the package's file.
    pub fn file_name(&self) -> &'static str {
        Path::new(self.url)
            .file_name()
            .and_then(|name| name.to_str())
            .unwrap_or(self.platform)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packages_are_fetched_by_https_and_have_whole_digests() {
        for wheel in &WHEELS {
            assert!(
                wheel.url.starts_with("https://") && wheel.url.contains(VERSION),
                "{}",
                wheel.url
            );
            assert!(
                wheel.sha256.len() == 64
                    && wheel.sha256.bytes().all(|byte| byte.is_ascii_hexdigit())
            );
            assert!(
                wheel.file_name().ends_with(".whl") && wheel.file_name().contains(wheel.platform)
            );
        }
    }
}

use std::fs::{self, File};
use std::io::{Error, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

use zip::ZipArchive;

use super::add::{Added, add};
use super::catalogue::{Catalogue, CatalogueEntry, NetworkFile};
use super::digests::sha256;
use super::download::fetch;
use super::error::NnError;
use super::runtime::library_name;

/// Progress of a download.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Fetched<'a> {
    /// Name of the file and its licence.
    pub what: &'a str,
    /// Number of bytes present.
    pub bytes: u64,
    /// Total number of bytes, if known.
    pub of: Option<u64>,
}

/// Maximum size of a file whose length is not known, in bytes.
const MAX_BYTES: u64 = 4 << 30;
/// Maximum size of a file unpacked from an archive, in bytes.
const MAX_UNPACKED_BYTES: u64 = 1 << 30;
/// Subfolder of the folder of networks for unfinished downloads.
const UNDER_WAY: &str = "downloads";

/// Downloads the files of a network (or the library of ONNX Runtime) and adds them.
///
/// `progress` receives the progress and returns whether to continue. The next call continues a
/// stopped or interrupted download.
///
/// # Errors
/// Fails if the name is unknown, or if the network has no download address (the message states how
/// to get it). Also fails if a download fails or has a wrong digest, and as [`add`].
pub fn install(
    catalogue: &Catalogue,
    folder: &Path,
    name: &str,
    progress: &mut dyn FnMut(Fetched<'_>) -> bool,
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
        vec![library(&downloads, progress)?]
    } else {
        urls.into_iter()
            .map(|(url, file)| download(entry, file, url, &downloads, progress))
            .collect::<Result<_, _>>()?
    };
    let added = add(catalogue, folder, name, &files);
    // This also removes rejected files, so that they are not reused. Leftovers do no harm.
    let _ = fs::remove_dir_all(&downloads);
    added
}

/// A file to download, with its digest.
struct Wanted<'a> {
    url: &'a str,
    sha256: &'a str,
    /// Size in bytes, if known.
    bytes: Option<u64>,
    /// Name shown during the download.
    what: &'a str,
}

/// Downloads a file of a network.
///
/// Its digest must be known, because the content of an address may change.
fn download(
    entry: &CatalogueEntry,
    file: &NetworkFile,
    url: &str,
    downloads: &Path,
    progress: &mut dyn FnMut(Fetched<'_>) -> bool,
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
        progress,
    )?;
    Ok(into)
}

/// Downloads a file and compares its digest; a file with another digest is deleted.
///
/// An existing file is only verified.
fn verified(
    wanted: &Wanted<'_>,
    into: &Path,
    progress: &mut dyn FnMut(Fetched<'_>) -> bool,
) -> Result<(), NnError> {
    let Wanted {
        url, bytes, what, ..
    } = *wanted;
    if !into.is_file() {
        let limit = bytes.unwrap_or(MAX_BYTES);
        fetch(url, into, limit, &mut |here| {
            progress(Fetched {
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

/// Downloads ONNX Runtime's official package and unpacks its library.
///
/// The package is verified before it is unpacked.
fn library(
    downloads: &Path,
    progress: &mut dyn FnMut(Fetched<'_>) -> bool,
) -> Result<PathBuf, NnError> {
    let package = RuntimePackage::for_this_system()?;
    let wanted = Wanted {
        url: package.url,
        sha256: package.sha256,
        bytes: Some(package.bytes),
        what: &format!("onnxruntime {VERSION}"),
    };
    let into = downloads.join(package.file_name());
    verified(&wanted, &into, progress)?;
    let library = downloads.join(library_name());
    let failed = |reason| NnError::Io {
        path: library.clone(),
        reason,
    };
    let mut file = File::create(&library).map_err(failed)?;
    unpack(&into, package.library, &mut file).map_err(failed)?;
    Ok(library)
}

/// Writes the file called `member` of the ZIP archive to `into` and ignores other files.
///
/// # Errors
/// Fails if the archive is damaged, has no such file, or the file is larger than 1 GiB.
fn unpack(archive: &Path, member: &str, into: &mut impl Write) -> std::io::Result<()> {
    let damaged = |what: &str| Error::new(ErrorKind::InvalidData, what.to_owned());
    let mut archive = ZipArchive::new(File::open(archive)?)?;
    let mut file = archive.by_name(member)?;
    let size = file.size();
    if size > MAX_UNPACKED_BYTES {
        return Err(damaged("a file in it is too large"));
    }
    let written = std::io::copy(&mut file.by_ref().take(size + 1), into)?;
    if written == size {
        Ok(())
    } else {
        Err(damaged("a file in it has another length than it should"))
    }
}

/// Version of ONNX Runtime that is installed.
const VERSION: &str = "1.31.1";

/// Package of ONNX Runtime for one system: a ZIP archive (a wheel) with the library.
#[derive(Debug)]
struct RuntimePackage {
    os: &'static str,
    arch: &'static str,
    /// Address of the package; it contains the file's BLAKE2b digest.
    url: &'static str,
    bytes: u64,
    sha256: &'static str,
    /// Path of the library in the archive.
    library: &'static str,
}

/// Packages of the Python Package Index.
///
/// The digests were computed from the files that it served in November 2026. Only the library is
/// taken from them, which depends on no version of Python.
const RUNTIME_PACKAGES: [RuntimePackage; 5] = [
    RuntimePackage {
        os: "macos",
        arch: "aarch64",
        url: "https://files.pythonhosted.org/packages/0e/f7/cecc0efeeea83bff2f7789ae1b80f27fa0f0210d6d9d66d1f0031a6b5e47/onnxruntime-1.31.1-cp312-cp312-macosx_14_0_arm64.whl",
        bytes: 20882125,
        sha256: "96dd2564b10ea7153ad9c207e7cd8e5917cb3ba521e0e0a62ac03486fdc8d56c",
        library: "onnxruntime/capi/libonnxruntime.1.31.1.dylib",
    },
    RuntimePackage {
        os: "linux",
        arch: "aarch64",
        url: "https://files.pythonhosted.org/packages/ba/e4/1ed1a7a5f4702d899091fa2b976d377995250c307326ec8dc9ae6378aa13/onnxruntime-1.31.1-cp312-cp312-manylinux_2_28_aarch64.whl",
        bytes: 21420803,
        sha256: "0b9a492176886992e0e875f06bc0367e333f5fff11711a2d642e18b02f3009cc",
        library: "onnxruntime/capi/libonnxruntime.so.1.31.1",
    },
    RuntimePackage {
        os: "linux",
        arch: "x86_64",
        url: "https://files.pythonhosted.org/packages/eb/27/c6a823bac55b2977bea2027c3ec9393a2c1002cb9a09eb40354563e02730/onnxruntime-1.31.1-cp312-cp312-manylinux_2_28_x86_64.whl",
        bytes: 23760988,
        sha256: "1f3dea47f2f0e5117c2404cea7d21fd253ae7836a3bf167a501cdfbb2600d536",
        library: "onnxruntime/capi/libonnxruntime.so.1.31.1",
    },
    RuntimePackage {
        os: "windows",
        arch: "x86_64",
        url: "https://files.pythonhosted.org/packages/45/b2/793b4051d8dc6acb379ead9b72050f0ffa283ca49a6904add2e218b83e2e/onnxruntime-1.31.1-cp312-cp312-win_amd64.whl",
        bytes: 14888466,
        sha256: "ae8a9a351efda685cc59a66226cdefaa37a126c1d66872ca23a2de9425326130",
        library: "onnxruntime/capi/onnxruntime.dll",
    },
    RuntimePackage {
        os: "windows",
        arch: "aarch64",
        url: "https://files.pythonhosted.org/packages/ed/72/09d635ab4b6137d8ac63d4911a37dad8b1ef15a77d20b65d7ed40fdca012/onnxruntime-1.31.1-cp312-cp312-win_arm64.whl",
        bytes: 14740724,
        sha256: "fe8b9ac1ae8e894e12c47ee82e4f6dfc1835768133687257866469fda80d0bf1",
        library: "onnxruntime/capi/onnxruntime.dll",
    },
];

impl RuntimePackage {
    /// Returns the package for this system.
    ///
    /// # Errors
    /// [`NnError::Request`] if there is none; the message states what to do instead.
    fn for_this_system() -> Result<&'static Self, NnError> {
        let (os, arch) = (std::env::consts::OS, std::env::consts::ARCH);
        RUNTIME_PACKAGES.iter().find(|package| (package.os, package.arch) == (os, arch)).ok_or_else(|| {
            NnError::Request(format!(
                "no verified file of ONNX Runtime is known for {os} on {arch}; install ONNX Runtime 1.24 or newer by other \
                 means and set ORT_DYLIB_PATH to its library, or run `ostra models add onnxruntime FILE`"
            ))
        })
    }

    /// Returns the file name of the package.
    fn file_name(&self) -> &'static str {
        Path::new(self.url)
            .file_name()
            .and_then(|name| name.to_str())
            .unwrap_or("onnxruntime.whl")
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use zip::CompressionMethod;
    use zip::write::SimpleFileOptions;

    use super::*;

    #[test]
    fn packages_have_https_addresses_and_complete_digests() {
        for package in &RUNTIME_PACKAGES {
            assert!(
                package.url.starts_with("https://") && package.url.contains(VERSION),
                "{}",
                package.url
            );
            assert!(
                package.sha256.len() == 64
                    && package.sha256.bytes().all(|byte| byte.is_ascii_hexdigit())
            );
            let platform = match (package.os, package.arch) {
                ("macos", "aarch64") => "macosx_14_0_arm64",
                ("linux", "aarch64") => "manylinux_2_28_aarch64",
                ("linux", "x86_64") => "manylinux_2_28_x86_64",
                ("windows", "x86_64") => "win_amd64",
                ("windows", "aarch64") => "win_arm64",
                other => panic!("{other:?}"),
            };
            assert!(
                package.file_name().ends_with(".whl") && package.file_name().contains(platform)
            );
        }
    }

    /// Creates an archive of one stored file whose directory lists `listed` bytes.
    fn archive(name: &str, content: &[u8], listed: u32) -> Vec<u8> {
        let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
        let stored = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
        zip.start_file(name, stored).unwrap();
        zip.write_all(content).unwrap();
        let mut bytes = zip.finish().unwrap().into_inner();
        let entry = bytes.windows(4).position(|four| four == b"PK\x01\x02");
        bytes[entry.unwrap() + 24..][..4].copy_from_slice(&listed.to_le_bytes());
        bytes
    }

    #[test]
    fn only_the_named_file_is_unpacked_and_damage_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.zip");
        let taken = |zip: &[u8], member: &str| {
            fs::write(&path, zip).unwrap();
            let mut into = Vec::new();
            unpack(&path, member, &mut into).map(|()| into)
        };
        let good = archive("x/lib.so", b"content", 7);
        assert_eq!(taken(&good, "x/lib.so").unwrap(), b"content");
        assert!(taken(&good, "lib.so").is_err(), "another name");
        let longer = archive("x/lib.so", b"content", 6);
        assert!(taken(&longer, "x/lib.so").is_err(), "longer than listed");
        let large = archive("x/lib.so", b"content", u32::MAX);
        assert!(taken(&large, "x/lib.so").is_err(), "too large");
        for length in 0..good.len() - 2 {
            assert!(
                taken(&good[..length], "x/lib.so").is_err(),
                "cut to {length} bytes"
            );
        }
    }
}

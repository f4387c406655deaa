use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use super::catalogue::{Catalogue, Entry, NetworkFile};
use super::digest::sha256;
use super::error::NnError;
use super::fetch::fetch;
use super::install::{Added, add};
use super::search::library_name;
use super::watched::watched;

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

/// Version of ONNX Runtime that is fetched.
const VERSION: &str = "1.31.1";
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
    let urls = entry.files().iter().map(|file| file.url.as_deref().zip(Some(file)));
    let urls = urls.collect::<Option<Vec<_>>>().ok_or_else(|| entry.without_address())?;
    fs::create_dir_all(&downloads).map_err(|source| NnError::Io { path: downloads.clone(), source })?;
    let files = if entry.is_library() {
        vec![library(&downloads, told)?]
    } else {
        urls.into_iter().map(|(url, file)| download(entry, file, url, &downloads, told)).collect::<Result<_, _>>()?
    };
    let added = add(catalogue, folder, name, &files);
    // Also what was refused, so that it is not taken for the file again; what is left there does no harm.
    let _ = fs::remove_dir_all(&downloads);
    added
}

fn download(
    entry: &Entry,
    file: &NetworkFile,
    url: &str,
    downloads: &Path,
    told: &mut dyn FnMut(Fetched<'_>) -> bool,
) -> Result<PathBuf, NnError> {
    let into = downloads.join(&file.name);
    let what = format!("{} ({})", file.name, entry.licence);
    if !into.exists() {
        fetch(url, &into, &mut |bytes| told(Fetched { what: &what, bytes, of: file.bytes }))?;
    }
    let Some(expected) = file.sha256.clone() else { return Ok(into) };
    let failed = |source| NnError::Io { path: into.clone(), source };
    let found = sha256(&into).map_err(failed)?;
    if found == expected {
        return Ok(into);
    }
    fs::remove_file(&into).map_err(failed)?;
    Err(NnError::Digest { path: PathBuf::from(url), expected, found })
}

/// ONNX Runtime's library, from its Python package where there is `pip`, else from the project's release.
fn library(downloads: &Path, told: &mut dyn FnMut(Fetched<'_>) -> bool) -> Result<PathBuf, NnError> {
    let package = format!("onnxruntime=={VERSION}");
    let unpacked = downloads.join("onnxruntime");
    for python in ["python3", "python"] {
        let what = format!("{package} by {python} -m pip");
        let mut goes_on = || told(Fetched { what: &what, bytes: 0, of: None });
        let pip = ["-m", "pip", "download", "--quiet", "--disable-pip-version-check", "--only-binary", ":all:"];
        let mut asked = Command::new(python);
        asked.args(pip).args(["--no-deps", "--dest"]).arg(downloads).arg(&package);
        let is_there = goes_on() && succeeds(&mut asked, &mut goes_on)?;
        if is_there && succeeds(&mut unzip(python, downloads, &unpacked), &mut goes_on)? {
            return found(&unpacked);
        }
    }
    let archive = release();
    let url = format!("https://github.com/microsoft/onnxruntime/releases/download/v{VERSION}/{archive}");
    let into = downloads.join(&archive);
    fetch(&url, &into, &mut |bytes| told(Fetched { what: &archive, bytes, of: None }))?;
    fs::create_dir_all(&unpacked).map_err(|source| NnError::Io { path: unpacked.clone(), source })?;
    let mut goes_on = || told(Fetched { what: &archive, bytes: 0, of: None });
    if !succeeds(Command::new("tar").arg("-xf").arg(&into).arg("-C").arg(&unpacked), &mut goes_on)? {
        return Err(NnError::Request(format!("{}: `tar` cannot unpack it; unpack it by hand", into.display())));
    }
    found(&unpacked)
}

fn unzip(python: &str, downloads: &Path, unpacked: &Path) -> Command {
    let is_wheel = |path: &PathBuf| path.extension().is_some_and(|extension| extension == "whl");
    let wheel = fs::read_dir(downloads).ok().and_then(|files| files.flatten().map(|file| file.path()).find(is_wheel));
    let mut command = Command::new(python);
    command.args(["-m", "zipfile", "-e"]).arg(wheel.unwrap_or_default()).arg(unpacked);
    command
}

/// Whether a program of the system does its work.
///
/// # Errors
/// When it is stopped.
fn succeeds(command: &mut Command, goes_on: &mut dyn FnMut() -> bool) -> Result<bool, NnError> {
    let ended = match watched(command, goes_on) {
        Ok(ended) => ended,
        Err(_) => return Ok(false),
    };
    let program = command.get_program().to_string_lossy().into_owned();
    let stopped = NnError::Fetch { url: program, what: "stopped".to_owned(), is_stopped: true };
    ended.map(|ended| ended.is_well()).ok_or(stopped)
}

/// The archive of the release for this system.
fn release() -> String {
    let system = match std::env::consts::OS {
        "macos" => "osx",
        "windows" => "win",
        other => other,
    };
    let processor = match std::env::consts::ARCH {
        "x86_64" => "x64",
        "aarch64" if system != "linux" => "arm64",
        other => other,
    };
    let kind = if system == "win" { "zip" } else { "tgz" };
    format!("onnxruntime-{system}-{processor}-{VERSION}.{kind}")
}

/// The library within an unpacked package; its name may end in its version.
fn found(unpacked: &Path) -> Result<PathBuf, NnError> {
    let name = library_name();
    let stem = name.trim_end_matches(std::env::consts::DLL_SUFFIX);
    let is_library = |path: &Path| {
        let file = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        let plain = file.strip_prefix(stem).is_some_and(|rest| rest.starts_with('.'));
        plain && file.contains(std::env::consts::DLL_SUFFIX)
    };
    let mut folders = vec![unpacked.to_owned()];
    while let Some(folder) = folders.pop() {
        let entries = fs::read_dir(&folder).map_err(|source| NnError::Io { path: folder.clone(), source })?;
        for path in entries.flatten().map(|entry| entry.path()) {
            if path.is_dir() {
                folders.push(path);
            } else if is_library(&path) {
                return Ok(path);
            }
        }
    }
    Err(NnError::Request(format!("{}: holds no {name}", unpacked.display())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_library_is_found_wherever_a_package_holds_it() {
        let scratch = tempfile::tempdir().unwrap();
        let inner = scratch.path().join("onnxruntime/capi");
        fs::create_dir_all(&inner).unwrap();
        let error = found(scratch.path()).unwrap_err().to_string();
        assert!(error.contains(&library_name()), "{error}");
        let stem = library_name().trim_end_matches(std::env::consts::DLL_SUFFIX).to_owned();
        let suffix = std::env::consts::DLL_SUFFIX;
        fs::write(inner.join(format!("{stem}_providers_shared{suffix}")), "").unwrap();
        assert!(found(scratch.path()).is_err(), "another library beside it is not it");
        let library = inner.join(format!("{stem}{suffix}.1.31.1"));
        fs::write(&library, "").unwrap();
        assert_eq!(found(scratch.path()).unwrap(), library);
    }

    #[test]
    fn the_release_is_named_as_its_makers_do() {
        let name = release();
        assert!(name.starts_with("onnxruntime-") && name.contains(VERSION), "{name}");
        if cfg!(all(target_os = "linux", target_arch = "x86_64")) {
            assert_eq!(name, format!("onnxruntime-linux-x64-{VERSION}.tgz"));
        }
    }
}

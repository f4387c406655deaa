use std::ffi::OsStr;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use super::error::NnError;
use super::watched::{Ended, watched};
use ostra_core::programs;

/// The protocols that `curl` may use, also after a redirect. The unit tests serve files without encryption.
const PROTOCOLS: &str = if cfg!(test) { "=http,https" } else { "=https" };

/// Gets a file of at most `limit` bytes from the net, unverified, with the system's `curl`. `told` hears how many bytes are there and whether to go on; what an
/// interrupted or stopped run left in `into` with `.part` behind its name the next one continues.
///
/// # Errors
/// [`NnError::Fetch`] without `curl`, where the address does not answer, or when stopped; [`NnError::Io`].
pub fn fetch(
    url: &str,
    into: &Path,
    limit: u64,
    told: &mut dyn FnMut(u64) -> bool,
) -> Result<(), NnError> {
    let part = with_suffix(into, ".part");
    let mut curl = run(url, &part, limit, told)?;
    if part.exists() && cannot_resume(&curl) && told(0) {
        fs::remove_file(&part).map_err(|reason| NnError::Io {
            path: part.clone(),
            reason,
        })?;
        curl = run(url, &part, limit, told)?;
    }
    if !curl.is_well() {
        let what = curl.said.trim_start_matches("curl: ").to_owned();
        return Err(NnError::Fetch {
            url: url.to_owned(),
            what,
            is_stopped: false,
        });
    }
    fs::rename(&part, into).map_err(|reason| NnError::Io {
        path: into.to_owned(),
        reason,
    })
}

/// Whether the server cannot continue, or has nothing beyond what is there.
fn cannot_resume(curl: &Ended) -> bool {
    matches!(curl.code, Some(33 | 36)) || curl.code == Some(22) && curl.said.contains("416")
}

fn run(
    url: &str,
    part: &Path,
    limit: u64,
    told: &mut dyn FnMut(u64) -> bool,
) -> Result<Ended, NnError> {
    let failed = |what: String, is_stopped: bool| NnError::Fetch {
        url: url.to_owned(),
        what,
        is_stopped,
    };
    let bytes = || fs::metadata(part).map_or(0, |file| file.len());
    let mut curl = programs::command("curl").map_err(|error| failed(error.to_string(), false))?;
    // `--disable`, which must come first, ignores ~/.curlrc: it may weaken what follows. Proxies are taken from the
    // environment (https_proxy).
    curl.args([
        "--disable",
        "--proto",
        PROTOCOLS,
        "--proto-redir",
        PROTOCOLS,
        "--max-filesize",
        &limit.to_string(),
    ])
    .args([
        "--fail",
        "--location",
        "--silent",
        "--show-error",
        "--connect-timeout",
        "30",
    ])
    .args([
        "--speed-limit",
        "1",
        "--speed-time",
        "60",
        "--continue-at",
        "-",
        "--output",
    ])
    .args([part.as_os_str(), OsStr::new("--url"), OsStr::new(url)]);
    let mut is_too_long = false;
    let mut goes_on = || {
        is_too_long |= bytes() > limit;
        !is_too_long && told(bytes())
    };
    let ended = watched(&mut curl, &mut goes_on).map_err(|error| match error.kind() {
        ErrorKind::NotFound => failed("`curl` is not installed".to_owned(), false),
        _ => failed(error.to_string(), false),
    })?;
    if is_too_long || bytes() > limit {
        fs::remove_file(part).map_err(|reason| NnError::Io {
            path: part.to_owned(),
            reason,
        })?;
        return Err(failed(
            format!("it is longer than the {limit} bytes that are expected"),
            false,
        ));
    }
    told(bytes());
    ended.ok_or_else(|| failed("stopped".to_owned(), true))
}

/// A path with something behind the name of its file.
fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(suffix);
    PathBuf::from(name)
}

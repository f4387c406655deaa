use std::ffi::OsStr;
use std::fs;
use std::io::{BufRead, BufReader, ErrorKind};
use std::path::{Path, PathBuf};
use std::process::{ChildStderr, Command, Stdio};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use super::error::NnError;
use ostra_core::programs;
use ostra_core::programs::ChildProcess;

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

/// How often it is asked whether to go on.
const ASKED_EVERY: Duration = Duration::from_millis(100);

/// How a program ended.
pub(super) struct Ended {
    /// Its exit code; `None` where a signal ended it.
    pub(super) code: Option<i32>,
    /// The last line that it wrote to its standard error.
    pub(super) said: String,
}

impl Ended {
    pub(super) fn is_well(&self) -> bool {
        self.code == Some(0)
    }
}

/// Runs a program of the system to its end, or, with `None`, until `goes_on` says no.
pub(super) fn watched(
    command: &mut Command,
    goes_on: &mut dyn FnMut() -> bool,
) -> std::io::Result<Option<Ended>> {
    let program = ChildProcess::spawn(
        command
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped()),
    )?;
    let (ended, waited) = channel();
    let stderr = program.take_stderr();
    // Ends with the program, which then closes what it writes to.
    std::thread::spawn(move || ended.send(last_line(stderr)));
    let said = loop {
        match waited.recv_timeout(ASKED_EVERY) {
            Err(RecvTimeoutError::Timeout) if !goes_on() => {
                program.kill()?;
                program.wait()?;
                return Ok(None);
            }
            Err(RecvTimeoutError::Timeout) => {}
            said => break said.unwrap_or_default(),
        }
    };
    Ok(Some(Ended {
        code: program.wait()?.code(),
        said,
    }))
}

fn last_line(stderr: Option<ChildStderr>) -> String {
    let lines = stderr
        .into_iter()
        .flat_map(|stderr| BufReader::new(stderr).lines().map_while(Result::ok));
    lines.last().unwrap_or_default()
}

#[cfg(test)]
#[cfg(unix)]
mod tests {
    use super::*;

    fn shell(script: &str) -> Command {
        let mut command = ostra_core::programs::command("sh").unwrap();
        command.args(["-c", script]);
        command
    }

    #[test]
    fn a_program_tells_how_it_ended() {
        let ended = watched(
            &mut shell("echo first >&2; echo last >&2; exit 7"),
            &mut || true,
        )
        .unwrap()
        .unwrap();
        assert_eq!(
            (ended.code, ended.said.as_str(), ended.is_well()),
            (Some(7), "last", false)
        );
        assert!(
            watched(&mut shell("exit 0"), &mut || true)
                .unwrap()
                .unwrap()
                .is_well()
        );
        assert!(watched(&mut Command::new("no-program-of-this-name"), &mut || true).is_err());
    }

    #[test]
    fn a_program_that_is_no_longer_wanted_is_ended() {
        let begun = std::time::Instant::now();
        assert!(
            watched(&mut shell("exec sleep 60"), &mut || false)
                .unwrap()
                .is_none()
        );
        assert!(
            begun.elapsed() < Duration::from_secs(30),
            "it did not sleep to its end"
        );
    }
}

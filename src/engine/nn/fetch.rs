use std::ffi::OsStr;
use std::fs;
use std::io::{BufRead, BufReader, ErrorKind};
use std::path::{Path, PathBuf};
use std::process::{ChildStderr, Command, Stdio};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use super::error::NnError;

/// How often it is told how much is there.
const TOLD_EVERY: Duration = Duration::from_millis(100);

/// Gets a file from the net with the system's `curl`. `told` hears how many bytes are there and whether to go on; what an
/// interrupted or stopped run left in `into` with `.part` behind its name the next one continues.
///
/// # Errors
/// [`NnError::Fetch`] without `curl`, where the address does not answer, or when stopped; [`NnError::Io`].
pub fn fetch(url: &str, into: &Path, told: &mut dyn FnMut(u64) -> bool) -> Result<(), NnError> {
    let part = with_suffix(into, ".part");
    let mut outcome = run(url, &part, told)?;
    if part.exists() && outcome.cannot_resume() && told(0) {
        fs::remove_file(&part).map_err(|source| NnError::Io { path: part.clone(), source })?;
        outcome = run(url, &part, told)?;
    }
    if outcome.code != Some(0) {
        return Err(NnError::Fetch { url: url.to_owned(), what: outcome.said, is_stopped: false });
    }
    fs::rename(&part, into).map_err(|source| NnError::Io { path: into.to_owned(), source })
}

/// How `curl` ended.
struct Outcome {
    code: Option<i32>,
    /// The last line that it wrote.
    said: String,
}

impl Outcome {
    /// Whether the server cannot continue, or has nothing beyond what is there.
    fn cannot_resume(&self) -> bool {
        matches!(self.code, Some(33 | 36)) || self.code == Some(22) && self.said.contains("416")
    }
}

fn run(url: &str, part: &Path, told: &mut dyn FnMut(u64) -> bool) -> Result<Outcome, NnError> {
    let failed = |what: String, is_stopped: bool| NnError::Fetch { url: url.to_owned(), what, is_stopped };
    let started = Command::new("curl")
        .args(["--fail", "--location", "--silent", "--show-error", "--connect-timeout", "30"])
        .args(["--speed-limit", "1", "--speed-time", "60", "--continue-at", "-", "--output"])
        .args([part.as_os_str(), OsStr::new(url)])
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn();
    let mut curl = started.map_err(|error| match error.kind() {
        ErrorKind::NotFound => failed("`curl` is not installed".to_owned(), false),
        _ => failed(error.to_string(), false),
    })?;
    let lost = |error: std::io::Error| failed(error.to_string(), false);
    let bytes = || fs::metadata(part).map_or(0, |file| file.len());
    let (ended, waited) = channel();
    let stderr = curl.stderr.take();
    // Ends with `curl`, which then closes what it writes to.
    std::thread::spawn(move || ended.send(last_line(stderr)));
    let said = loop {
        match waited.recv_timeout(TOLD_EVERY) {
            Err(RecvTimeoutError::Timeout) if !told(bytes()) => {
                curl.kill().and_then(|()| curl.wait().map(drop)).map_err(lost)?;
                return Err(failed("stopped".to_owned(), true));
            }
            Err(RecvTimeoutError::Timeout) => {}
            said => break said.unwrap_or_default(),
        }
    };
    let status = curl.wait().map_err(lost)?;
    told(bytes());
    Ok(Outcome { code: status.code(), said })
}

/// The last line that `curl` wrote.
fn last_line(stderr: Option<ChildStderr>) -> String {
    let lines = stderr.into_iter().flat_map(|stderr| BufReader::new(stderr).lines().map_while(Result::ok));
    lines.last().unwrap_or_default().trim_start_matches("curl: ").to_owned()
}

/// A path with something behind the name of its file.
pub(super) fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(suffix);
    PathBuf::from(name)
}

//! Tests that large files are downloaded in ranges at the same time, and never mixed.
// Trusted authorities are taken from the environment only on Linux.
#![cfg(target_os = "linux")]

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::{Arc, Condvar, Mutex};
use std::time::Duration;

use sha2::{Digest, Sha256};

use crate::fake_sites::{FakeSites, SiteRequest};

/// Size of each range that the program requests of a file of [`SIZE`].
const RANGE: u64 = 4 << 20;
/// Size of the served file: five ranges and a short one.
const SIZE: u64 = 5 * RANGE + 4321;
/// Number of ranges that are fetched at the same time.
const CONNECTIONS: usize = 4;
/// Number of bytes that an interrupted response has.
const BROKEN_BYTES: u64 = 1 << 20;

/// File of a site.
struct SiteFile {
    bytes: Vec<u8>,
    etag: &'static str,
}

impl SiteFile {
    fn new(seed: u64) -> Self {
        let byte = |at: u64| ((at * at + seed) % 251) as u8;
        Self {
            bytes: (0..SIZE).map(byte).collect(),
            etag: if seed == 0 { "\"first\"" } else { "\"other\"" },
        }
    }

    /// Answers a request as public servers do; the body ends after `limit` bytes.
    fn answer(
        &self,
        request: &SiteRequest,
        limit: u64,
        stream: &mut dyn Write,
    ) -> std::io::Result<()> {
        let (first, last) = request.range.map_or((0, SIZE - 1), |(first, last)| {
            (first, last.unwrap_or(SIZE - 1).min(SIZE - 1))
        });
        let range = format!("Content-Range: bytes {first}-{last}/{SIZE}\r\n");
        let (status, range) = match request.range {
            Some(_) => ("206 Partial Content", range.as_str()),
            None => ("200 OK", ""),
        };
        let (length, etag) = (last + 1 - first, self.etag);
        write!(
            stream,
            "HTTP/1.1 {status}\r\nContent-Length: {length}\r\n{range}Accept-Ranges: bytes\r\nETag: {etag}\r\n\
             Connection: close\r\n\r\n"
        )?;
        let end = (last + 1).min(first.saturating_add(limit));
        stream.write_all(&self.bytes[first as usize..end as usize])?;
        stream.flush()
    }

    fn digest(&self) -> String {
        let digest = Sha256::digest(&self.bytes);
        digest.iter().map(|byte| format!("{byte:02x}")).collect()
    }
}

/// First bytes of the requests to a site; `None` for the whole file.
type Asked = Arc<Mutex<Vec<Option<u64>>>>;

/// Writes a catalogue that has a file of weights called `big`, with this digest.
fn catalogue(folder: &Path, sha256: Option<&str>) -> PathBuf {
    let digest = sha256.map_or(String::new(), |digest| format!("sha256 = '{digest}'\n"));
    let text = format!(
        "[[entry]]\nname = 'big'\npurpose = 'p'\nlicence = 'MIT'\nsource = 'https://s'\n[[entry.file]]\nname = 'big.bin'\n\
         data = true\nurl = 'https://github.com/big.bin'\nbytes = {SIZE}\n{digest}"
    );
    let path = folder.join("networks.toml");
    std::fs::write(&path, text).unwrap();
    path
}

fn command(sites: &FakeSites, folder: &Path, sha256: Option<&str>) -> Command {
    let mut command = sites.command(&sites.authority, folder, "big", "/bin");
    command.env("OSTRA_NETWORKS", catalogue(folder, sha256));
    command
}

fn install(sites: &FakeSites, folder: &Path, file: &SiteFile) -> Output {
    let digest = file.digest();
    command(sites, folder, Some(&digest)).output().unwrap()
}

fn models(folder: &Path) -> PathBuf {
    folder.join("data/ostra/models")
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn assert_is_installed(output: &Output, folder: &Path, file: &SiteFile) {
    assert!(output.status.success(), "{}", stderr(output));
    let installed = std::fs::read(models(folder).join("big.bin")).unwrap();
    assert!(installed == file.bytes);
    assert!(!models(folder).join("downloads/big").exists());
}

fn assert_is_not_installed(output: &Output, folder: &Path, reported: &str) {
    assert!(!output.status.success());
    assert!(stderr(output).contains(reported), "{}", stderr(output));
    assert!(!models(folder).join("big.bin").exists());
}

/// Starts a site of the file whose responses end after `limit` bytes.
fn site(file: &Arc<SiteFile>, limit: u64) -> (FakeSites, Asked) {
    let (file, asked) = (Arc::clone(file), Asked::default());
    let log = Arc::clone(&asked);
    let sites = FakeSites::start_writing(move |request, stream| {
        log.lock()
            .unwrap()
            .push(request.range.map(|(first, _)| first));
        file.answer(request, limit, stream)
    });
    (sites, asked)
}

/// Returns the first bytes of the requests, in order.
fn sorted(asked: &Asked) -> Vec<Option<u64>> {
    let mut asked = asked.lock().unwrap().clone();
    asked.sort();
    asked
}

#[test]
fn ranges_of_a_large_file_are_fetched_at_the_same_time() {
    let file = Arc::new(SiteFile::new(0));
    let served = Arc::clone(&file);
    // Number of requests so far, and whether all that are expected came before any was answered.
    let gate = Arc::new((Mutex::new((0, false)), Condvar::new()));
    let seen = Arc::clone(&gate);
    let sites = FakeSites::start_writing(move |request, stream| {
        if request.range.is_none_or(|(first, _)| first == 0) {
            // The first answer says that there are more ranges.
            served.answer(request, 0, stream)?;
        }
        let (counts, all_came) = &*seen;
        let mut counts = counts.lock().unwrap();
        counts.0 += 1;
        if counts.0 == CONNECTIONS {
            counts.1 = true;
            all_came.notify_all();
        }
        let limit = Duration::from_secs(60);
        let waiting = all_came.wait_timeout_while(counts, limit, |counts| !counts.1);
        drop(waiting.unwrap());
        match request.range {
            Some((0, Some(last))) => stream.write_all(&served.bytes[..=last as usize]),
            _ => served.answer(request, u64::MAX, stream),
        }
    });
    let folder = tempfile::tempdir().unwrap();
    let output = install(&sites, folder.path(), &file);
    assert!(gate.0.lock().unwrap().1, "ranges came one after the other");
    assert_is_installed(&output, folder.path(), &file);
    assert!(
        stderr(&output).contains(&format!(" of {:.1} MB", SIZE as f64 / 1e6)),
        "{}",
        stderr(&output)
    );
}

#[test]
fn interrupted_download_is_resumed_in_each_range() {
    let file = Arc::new(SiteFile::new(0));
    let (broken, asked) = site(&file, BROKEN_BYTES);
    let folder = tempfile::tempdir().unwrap();
    let output = install(&broken, folder.path(), &file);
    assert_is_not_installed(&output, folder.path(), "kept for another try");
    let first_ranges: Vec<_> = (0..4).map(|range| Some(range * RANGE)).collect();
    assert_eq!(sorted(&asked), first_ranges);
    let (good, asked) = site(&file, u64::MAX);
    let output = install(&good, folder.path(), &file);
    assert_is_installed(&output, folder.path(), &file);
    let rest = (0..6).map(|range| Some(range * RANGE + if range < 4 { BROKEN_BYTES } else { 0 }));
    assert_eq!(sorted(&asked), rest.collect::<Vec<_>>());
}

#[test]
fn server_without_ranges_sends_one_stream() {
    let file = Arc::new(SiteFile::new(0));
    let (served, asked) = (Arc::clone(&file), Asked::default());
    let log = Arc::clone(&asked);
    let sites = FakeSites::start_writing(move |request, stream| {
        log.lock()
            .unwrap()
            .push(request.range.map(|(first, _)| first));
        let whole = SiteRequest {
            line: String::new(),
            range: None,
        };
        served.answer(&whole, u64::MAX, stream)
    });
    let folder = tempfile::tempdir().unwrap();
    let output = install(&sites, folder.path(), &file);
    assert_is_installed(&output, folder.path(), &file);
    assert_eq!(sorted(&asked), [Some(0)], "one request");
}

#[test]
fn file_that_changes_between_its_ranges_is_not_mixed() {
    for has_known_digest in [true, false] {
        let (before, after) = (SiteFile::new(0), Arc::new(SiteFile::new(1)));
        let served = Arc::clone(&after);
        let sites = FakeSites::start_writing(move |request, stream| match request.range {
            Some((0, _)) => before.answer(request, u64::MAX, stream),
            _ => served.answer(request, u64::MAX, stream),
        });
        let folder = tempfile::tempdir().unwrap();
        let digest = after.digest();
        let output = command(&sites, folder.path(), has_known_digest.then_some(&digest))
            .output()
            .unwrap();
        assert_is_installed(&output, folder.path(), &after);
    }
}

#[test]
fn mixed_file_of_a_server_that_hides_the_change_is_refused() {
    let (before, after) = (Arc::new(SiteFile::new(0)), SiteFile::new(1));
    let served = Arc::clone(&before);
    let sites = FakeSites::start_writing(move |request, stream| match request.range {
        Some((RANGE, _)) => {
            let lying = SiteFile {
                bytes: after.bytes.clone(),
                etag: served.etag,
            };
            lying.answer(request, u64::MAX, stream)
        }
        _ => served.answer(request, u64::MAX, stream),
    });
    let folder = tempfile::tempdir().unwrap();
    let output = install(&sites, folder.path(), &before);
    assert_is_not_installed(&output, folder.path(), "SHA-256");
}

#[expect(
    clippy::disallowed_methods,
    reason = "another process writes the file for which the test waits"
)]
fn wait_for_text(path: &Path, text: &str, child: &mut Child) {
    while !std::fs::read_to_string(path).is_ok_and(|found| found.contains(text)) {
        assert!(child.try_wait().unwrap().is_none(), "ended too early");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn stopped_download_keeps_what_came_of_each_range() {
    let file = Arc::new(SiteFile::new(0));
    let served = Arc::clone(&file);
    // Never notified: the responses stall until the program closes the connection.
    let stalled = Arc::new((Mutex::new(()), Condvar::new()));
    let sites = FakeSites::start_writing(move |request, stream| {
        served.answer(request, BROKEN_BYTES, stream)?;
        let (lock, never) = &*stalled;
        let waiting = never.wait_timeout(lock.lock().unwrap(), Duration::from_secs(120));
        drop(waiting.unwrap());
        Ok(())
    });
    let folder = tempfile::tempdir().unwrap();
    let mut child = command(&sites, folder.path(), Some(&file.digest()))
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let record = models(folder.path()).join("downloads/big/big.bin.part.toml");
    let came = format!("at = {}", 3 * RANGE + BROKEN_BYTES);
    wait_for_text(&record, &came, &mut child);
    let interrupt = Command::new("kill")
        .args(["-INT", &child.id().to_string()])
        .status();
    assert!(interrupt.unwrap().success());
    let output = child.wait_with_output().unwrap();
    assert_is_not_installed(&output, folder.path(), "stopped");
    let (good, asked) = site(&file, u64::MAX);
    let output = install(&good, folder.path(), &file);
    assert_is_installed(&output, folder.path(), &file);
    assert!(
        sorted(&asked).contains(&Some(3 * RANGE + BROKEN_BYTES)),
        "{:?}",
        sorted(&asked)
    );
}

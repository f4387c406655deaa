use std::fs::{self, File, OpenOptions};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{RecvTimeoutError, SyncSender, sync_channel};
use std::time::{Duration, Instant};

use ureq::http::{Response, StatusCode};
use ureq::tls::{RootCerts, TlsConfig};
use ureq::{Agent, Body};

use super::error::NnError;

/// Only unit tests may use plain HTTP.
const HTTPS_ONLY: bool = !cfg!(test);
/// Maximum time to reach a server.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(30);
/// Maximum time without receiving data.
const STALL_TIMEOUT: Duration = Duration::from_secs(60);
/// Interval between two calls of the progress callback.
const PROGRESS_INTERVAL: Duration = Duration::from_millis(100);
/// Size of the chunks passed to the file.
const CHUNK_BYTES: usize = 1 << 16;
/// Maximum number of chunks that wait for the disk.
const WAITING_CHUNKS: usize = 8;

/// Downloads a file of at most `limit` bytes without verifying it.
///
/// Only HTTPS is allowed, redirects included; the environment's proxy is used. `progress` receives
/// the number of bytes present and returns whether to continue. An interrupted or stopped download
/// stays next to `into` as `NAME.part`, and the next call continues it.
///
/// # Errors
/// [`NnError::Fetch`] if the address does not answer or the download is stopped, or
/// [`NnError::Io`].
pub fn fetch(
    url: &str,
    into: &Path,
    limit: u64,
    progress: &mut dyn FnMut(u64) -> bool,
) -> Result<(), NnError> {
    let download = Download {
        url,
        part: &with_suffix(into, ".part"),
        limit,
    };
    if download.run(progress)? == Transfer::NotResumable {
        fs::remove_file(download.part).map_err(|reason| download.io_error(reason))?;
        if !progress(0) {
            return Err(download.stopped());
        }
        download.run(progress)?;
    }
    fs::rename(download.part, into).map_err(|reason| NnError::Io {
        path: into.to_owned(),
        reason,
    })
}

/// One download.
struct Download<'a> {
    url: &'a str,
    /// File that receives the bytes until the download is complete.
    part: &'a Path,
    limit: u64,
}

/// How a transfer without error ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Transfer {
    Complete,
    /// The server cannot continue at the end of the part file, or has nothing beyond it.
    NotResumable,
}

/// Message of the network thread.
enum Message {
    /// The server answered; its bytes belong at this offset of the file.
    Started {
        offset: u64,
        /// Number of bytes that follow, if the server reports it.
        length: Option<u64>,
    },
    Chunk(Vec<u8>),
    Ended(Result<Transfer, String>),
}

impl Download<'_> {
    /// Continues the part file, or starts it.
    fn run(&self, progress: &mut dyn FnMut(u64) -> bool) -> Result<Transfer, NnError> {
        let mut bytes = fs::metadata(self.part).map_or(0, |file| file.len());
        let (sender, messages) = sync_channel(WAITING_CHUNKS);
        let (url, start) = (self.url.to_owned(), bytes);
        // This needs its own thread, because a stop must not wait for the network. The thread ends
        // once nothing receives its messages, at the latest after the timeouts. It never touches
        // the disk.
        std::thread::Builder::new()
            .name("download".into())
            .spawn(move || {
                let ended = transfer(&agent(HTTPS_ONLY), &url, start, &sender);
                let _ = sender.send(Message::Ended(ended));
            })
            .map_err(|error| self.failed(error.to_string()))?;
        let mut file = None;
        let mut reported = Instant::now();
        let ended = loop {
            match messages.recv_timeout(PROGRESS_INTERVAL) {
                Ok(Message::Started { offset, length }) => {
                    self.check_length(offset.saturating_add(length.unwrap_or(0)))?;
                    file = Some(self.open(offset)?);
                    bytes = offset;
                }
                Ok(Message::Chunk(chunk)) => {
                    self.check_length(bytes + chunk.len() as u64)?;
                    if let Some(file) = &mut file {
                        file.write_all(&chunk)
                            .map_err(|reason| self.io_error(reason))?;
                        bytes += chunk.len() as u64;
                    }
                }
                Ok(Message::Ended(ended)) => break ended,
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break Err("the transfer failed".into()),
            }
            if reported.elapsed() >= PROGRESS_INTERVAL {
                if !progress(bytes) {
                    return Err(self.stopped());
                }
                reported = Instant::now();
            }
        };
        progress(bytes);
        ended.map_err(|what| self.failed(what))
    }

    fn open(&self, offset: u64) -> Result<File, NnError> {
        let mut options = OpenOptions::new();
        options.create(true);
        if offset == 0 {
            options.write(true).truncate(true);
        } else {
            options.append(true);
        }
        options
            .open(self.part)
            .map_err(|reason| self.io_error(reason))
    }

    /// Rejects a file that is longer than expected, and deletes it.
    fn check_length(&self, bytes: u64) -> Result<(), NnError> {
        let limit = self.limit;
        if bytes <= limit {
            return Ok(());
        }
        if self.part.exists() {
            fs::remove_file(self.part).map_err(|reason| self.io_error(reason))?;
        }
        Err(self.failed(format!(
            "it is longer than the {limit} bytes that are expected"
        )))
    }

    fn failed(&self, what: String) -> NnError {
        NnError::Fetch {
            url: self.url.to_owned(),
            what,
            is_stopped: false,
        }
    }

    fn stopped(&self) -> NnError {
        NnError::Fetch {
            url: self.url.to_owned(),
            what: "stopped".to_owned(),
            is_stopped: true,
        }
    }

    fn io_error(&self, reason: std::io::Error) -> NnError {
        NnError::Io {
            path: self.part.to_owned(),
            reason,
        }
    }
}

/// Creates an agent that verifies certificates as the system does.
///
/// This also accepts the certificates of a company's proxy.
fn agent(https_only: bool) -> Agent {
    let tls = TlsConfig::builder()
        .root_certs(RootCerts::PlatformVerifier)
        .unversioned_rustls_crypto_provider(Arc::new(rustls::crypto::ring::default_provider()))
        .build();
    Agent::config_builder()
        .https_only(https_only)
        .http_status_as_error(false)
        .timeout_connect(Some(CONNECT_TIMEOUT))
        .timeout_per_read(Some(STALL_TIMEOUT))
        .tls_config(tls)
        .build()
        .into()
}

/// Requests the bytes from `start` on and sends them to `sender`.
///
/// Ends when all are sent or nothing receives them any more.
fn transfer(
    agent: &Agent,
    url: &str,
    start: u64,
    sender: &SyncSender<Message>,
) -> Result<Transfer, String> {
    let mut request = agent.get(url);
    if start > 0 {
        request = request.header("Range", format!("bytes={start}-"));
    }
    let response = request.call().map_err(|error| explain(&error))?;
    let offset = match response.status() {
        StatusCode::OK => 0,
        StatusCode::PARTIAL_CONTENT if start > 0 && range_start(&response) == Some(start) => start,
        StatusCode::PARTIAL_CONTENT | StatusCode::RANGE_NOT_SATISFIABLE if start > 0 => {
            return Ok(Transfer::NotResumable);
        }
        status => return Err(format!("the server answers {status}")),
    };
    let body = response.into_body();
    let length = body.content_length();
    if sender.send(Message::Started { offset, length }).is_err() {
        return Ok(Transfer::Complete);
    }
    let mut reader = body.into_reader();
    let mut received = 0;
    loop {
        let mut chunk = vec![0; CHUNK_BYTES];
        let count = reader.read(&mut chunk).map_err(|error| error.to_string())?;
        if count == 0 {
            break;
        }
        chunk.truncate(count);
        received += count as u64;
        if sender.send(Message::Chunk(chunk)).is_err() {
            return Ok(Transfer::Complete);
        }
    }
    match length {
        Some(length) if received < length => Err("the connection broke off".into()),
        _ => Ok(Transfer::Complete),
    }
}

/// Returns the first byte of a partial answer (`Content-Range: bytes START-END/SIZE`).
fn range_start(response: &Response<Body>) -> Option<u64> {
    let range = response.headers().get("Content-Range")?.to_str().ok()?;
    let (start, _) = range.strip_prefix("bytes ")?.split_once('-')?;
    start.parse().ok()
}

fn explain(error: &ureq::Error) -> String {
    match error {
        ureq::Error::RequireHttpsOnly(url) => {
            format!("only https is allowed, redirects included, and this leads to {url}")
        }
        ureq::Error::HostNotFound => "the server's name is not known".into(),
        error => error.to_string(),
    }
}

/// Appends a suffix to the file name of a path.
fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(suffix);
    PathBuf::from(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plain_http_is_rejected() {
        let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        listener.set_nonblocking(true).unwrap();
        let url = format!("http://{}/file", listener.local_addr().unwrap());
        let (sender, _messages) = sync_channel(1);
        let error = transfer(&agent(true), &url, 0, &sender).unwrap_err();
        assert!(
            error.contains("only https") && error.contains(&url),
            "{error}"
        );
        assert!(listener.accept().is_err(), "no connection was made");
    }
}

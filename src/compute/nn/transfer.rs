//! One request for a file, or for a range of it, on a thread of its own.

use std::io::Read;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::mpsc::SyncSender;
use std::time::Duration;

use ureq::http::{HeaderMap, Response, StatusCode};
use ureq::tls::{RootCerts, TlsConfig};
use ureq::{Agent, Body};

use super::unfinished::FileVersion;

/// Maximum time to reach a server.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(30);
/// Maximum time without receiving data.
const STALL_TIMEOUT: Duration = Duration::from_secs(60);
/// Size of the chunks passed to the file.
const CHUNK_BYTES: usize = 1 << 16;

/// Bytes of a file that are requested.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ByteRange {
    /// First byte.
    pub start: u64,
    /// The byte after the last one; `None` requests all that follow.
    pub end: Option<u64>,
}

impl ByteRange {
    /// The whole file. The request does not mention ranges.
    pub const ALL: Self = Self {
        start: 0,
        end: None,
    };

    fn header(self) -> Option<String> {
        let Self { start, end } = self;
        match end {
            Some(end) => Some(format!("bytes={start}-{}", end.saturating_sub(1))),
            None if start > 0 => Some(format!("bytes={start}-")),
            None => None,
        }
    }
}

/// What a server states before the bytes of a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Answer {
    /// Whether the server answers with a range and not with the whole file.
    pub is_range: bool,
    /// First byte that follows.
    pub start: u64,
    /// The byte after the last one that follows, if known.
    pub end: Option<u64>,
    /// Size of the whole file, if known.
    pub size: Option<u64>,
    /// Version of the file.
    pub version: FileVersion,
}

/// Message of a transfer.
#[derive(Debug)]
pub(super) enum Message {
    /// The server answered; the bytes follow.
    Started(Answer),
    Chunk(Vec<u8>),
    Ended(TransferEnd),
}

/// How a transfer ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum TransferEnd {
    /// All bytes that the server announced were sent on, or nothing receives them any more.
    Complete,
    /// The server does not answer requests for this range, or answers with an unusable one.
    RangeRefused,
    Failed(String),
}

/// Starts a transfer on a thread of its own, because a stop must not wait for the network.
///
/// The messages carry `id`. The thread ends once nothing receives them, at the latest after the
/// timeouts. It never touches the disk.
///
/// # Errors
/// Fails if the system starts no thread.
pub(super) fn start(
    agent: &Agent,
    url: &str,
    range: ByteRange,
    id: usize,
    sender: &SyncSender<(usize, Message)>,
) -> std::io::Result<()> {
    let (agent, url, sender) = (agent.clone(), url.to_owned(), sender.clone());
    std::thread::Builder::new()
        .name("download".into())
        .spawn(move || {
            let mut send = |message| sender.send((id, message)).is_ok();
            let ended = catch_unwind(AssertUnwindSafe(|| {
                transfer(&agent, &url, range, &mut send)
            }));
            let ended = ended.unwrap_or_else(|_| TransferEnd::Failed("the transfer failed".into()));
            let _ = sender.send((id, Message::Ended(ended)));
        })
        .map(drop)
}

/// Creates an agent that verifies certificates as the system does.
///
/// This also accepts the certificates of a company's proxy.
pub(super) fn agent(https_only: bool) -> Agent {
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

/// Requests a range and passes the answer and the bytes to `send`, which returns whether to go on.
fn transfer(
    agent: &Agent,
    url: &str,
    range: ByteRange,
    send: &mut dyn FnMut(Message) -> bool,
) -> TransferEnd {
    let mut request = agent.get(url);
    let header = range.header();
    if let Some(header) = &header {
        request = request.header("Range", header);
    }
    let response = match request.call() {
        Ok(response) => response,
        Err(error) => return TransferEnd::Failed(explain(&error)),
    };
    let answer = match response.status() {
        StatusCode::OK => whole_file(&response),
        StatusCode::PARTIAL_CONTENT if header.is_some() => match part_of_file(&response) {
            Some(answer) => answer,
            None => return TransferEnd::RangeRefused,
        },
        StatusCode::RANGE_NOT_SATISFIABLE
        | StatusCode::BAD_REQUEST
        | StatusCode::NOT_IMPLEMENTED
            if header.is_some() =>
        {
            return TransferEnd::RangeRefused;
        }
        status => return TransferEnd::Failed(format!("the server answers {status}")),
    };
    if !send(Message::Started(answer)) {
        return TransferEnd::Complete;
    }
    match pass_on(response.into_body(), send) {
        Ok(()) => TransferEnd::Complete,
        Err(what) => TransferEnd::Failed(what),
    }
}

fn pass_on(body: Body, send: &mut dyn FnMut(Message) -> bool) -> Result<(), String> {
    let length = body.content_length();
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
        if !send(Message::Chunk(chunk)) {
            return Ok(());
        }
    }
    match length {
        Some(length) if received < length => Err(BROKEN_OFF.into()),
        _ => Ok(()),
    }
}

/// Message for fewer bytes than the server announced.
pub(super) const BROKEN_OFF: &str = "the connection broke off";

fn whole_file(response: &Response<Body>) -> Answer {
    let length = response.body().content_length();
    Answer {
        is_range: false,
        start: 0,
        end: length,
        size: length,
        version: version(response.headers()),
    }
}

/// Reads `Content-Range: bytes FIRST-LAST/SIZE`; SIZE may be `*`.
///
/// Returns `None` if it contradicts itself or the length of the body.
fn part_of_file(response: &Response<Body>) -> Option<Answer> {
    let range = text(response.headers(), "Content-Range")?;
    let (bytes, size) = range.strip_prefix("bytes ")?.split_once('/')?;
    let (first, last) = bytes.split_once('-')?;
    let (start, last): (u64, u64) = (first.parse().ok()?, last.parse().ok()?);
    let size: Option<u64> = match size {
        "*" => None,
        size => Some(size.parse().ok()?),
    };
    let end = last.checked_add(1)?;
    let length = response.body().content_length();
    let is_consistent = start < end
        && size.is_none_or(|size| end <= size)
        && length.is_none_or(|length| length == end - start);
    is_consistent.then(|| Answer {
        is_range: true,
        start,
        end: Some(end),
        size,
        version: version(response.headers()),
    })
}

fn version(headers: &HeaderMap) -> FileVersion {
    FileVersion {
        etag: text(headers, "ETag").map(str::to_owned),
        last_modified: text(headers, "Last-Modified").map(str::to_owned),
    }
}

fn text<'a>(headers: &'a HeaderMap, name: &str) -> Option<&'a str> {
    headers.get(name)?.to_str().ok()
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plain_http_is_rejected() {
        let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        listener.set_nonblocking(true).unwrap();
        let url = format!("http://{}/file", listener.local_addr().unwrap());
        let ended = transfer(&agent(true), &url, ByteRange::ALL, &mut |_| true);
        let TransferEnd::Failed(error) = ended else {
            panic!("{ended:?}");
        };
        assert!(
            error.contains("only https") && error.contains(&url),
            "{error}"
        );
        assert!(listener.accept().is_err(), "no connection was made");
    }
}

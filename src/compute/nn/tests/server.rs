//! A local server that has files as public servers have them.

use std::collections::BTreeMap;
use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::sync::{Arc, Mutex};

use crate::nn::digests::sha256;

/// Serves files over HTTP, with ranges.
pub(super) struct Server {
    pub(super) address: String,
    /// Paths of all requests, with the first byte asked for.
    requests: Arc<Mutex<Vec<(String, usize)>>>,
}

impl Server {
    /// Starts a server; the first response breaks off after `first_bytes`.
    pub(super) fn start(files: &[(&str, Vec<u8>)], first_bytes: Option<usize>) -> Self {
        let files: BTreeMap<String, Vec<u8>> = files
            .iter()
            .map(|(name, bytes)| (format!("/{name}"), bytes.clone()))
            .collect();
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = format!("http://{}", listener.local_addr().unwrap());
        let requests = Arc::new(Mutex::new(Vec::new()));
        let log = Arc::clone(&requests);
        std::thread::spawn(move || {
            let mut limit = first_bytes;
            for stream in listener.incoming() {
                let stream = stream.unwrap();
                let (path, start) = request(&stream);
                let limit = limit.take().unwrap_or(usize::MAX);
                let file = files.get(&path);
                log.lock().unwrap().push((path, start));
                // The test checks clients that close the connection early.
                let _ = answer(&stream, file.map(Vec::as_slice), start, limit);
            }
        });
        Self { address, requests }
    }

    pub(super) fn url(&self, name: &str) -> String {
        format!("{}/{name}", self.address)
    }

    pub(super) fn requests(&self) -> Vec<(String, usize)> {
        self.requests.lock().unwrap().clone()
    }
}

/// Returns the path of a request, and the first byte that it asks for.
fn request(stream: &TcpStream) -> (String, usize) {
    let mut lines = BufReader::new(stream).lines().map_while(Result::ok);
    let first = lines.next().unwrap_or_default();
    let path = first.split(' ').nth(1).unwrap_or_default().to_owned();
    let mut start = 0;
    for line in lines.take_while(|line| !line.is_empty()) {
        let line = line.to_lowercase();
        if let Some(range) = line.strip_prefix("range: bytes=") {
            start = range.trim_end_matches('-').parse().unwrap_or(0);
        }
    }
    (path, start)
}

fn answer(
    mut stream: &TcpStream,
    file: Option<&[u8]>,
    start: usize,
    limit: usize,
) -> std::io::Result<()> {
    let Some(file) = file else {
        let head = "HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\nConnection: close\r\n\r\n";
        return stream.write_all(head.as_bytes());
    };
    let (status, range) = if start > 0 {
        let last = file.len() - 1;
        let range = format!("Content-Range: bytes {start}-{last}/{}\r\n", file.len());
        ("206 Partial Content", range)
    } else {
        ("200 OK", String::new())
    };
    let length = file.len() - start;
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Length: {length}\r\n{range}Connection: close\r\n\r\n"
    );
    stream.write_all(head.as_bytes())?;
    let end = file.len().min(start.saturating_add(limit));
    stream.write_all(&file[start..end])
}

/// Returns a network that `tests/parity/public.py` wrote.
pub(super) fn public(name: &str) -> Vec<u8> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/parity/public");
    fs::read(folder.join(name)).unwrap()
}

pub(super) fn digest(bytes: &[u8]) -> String {
    let file = tempfile::NamedTempFile::new().unwrap();
    fs::write(file.path(), bytes).unwrap();
    sha256(file.path()).unwrap()
}

//! Downloads in ranges, from servers that answer them well, badly or not at all.

use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::{Arc, Mutex};

use crate::nn::NnError;
use crate::nn::download::{DownloadRequest, fetch};

/// A size that takes five ranges, the last one short.
const SIZE: usize = (16 << 20) + 1234;
/// Size of each range but the last.
const RANGE: usize = 4 << 20;

/// First and last byte that a request asks for; `None` for the whole file.
type Asked = Option<(usize, usize)>;

/// Returns the head and the body for the request of this number.
type Script = fn(&[u8], Asked, usize) -> (String, Vec<u8>);

/// Serves a file by a script.
struct Scripted {
    url: String,
    file: Vec<u8>,
    asked: Arc<Mutex<Vec<Asked>>>,
}

impl Scripted {
    fn start(script: Script) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("http://{}/file", listener.local_addr().unwrap());
        let file: Vec<u8> = (0..SIZE).map(|at| (at * at % 251) as u8).collect();
        let asked = Arc::new(Mutex::new(Vec::new()));
        let (served, log) = (Arc::new(file.clone()), Arc::clone(&asked));
        std::thread::spawn(move || {
            for stream in listener.incoming() {
                let (served, log) = (Arc::clone(&served), Arc::clone(&log));
                std::thread::spawn(move || {
                    let mut stream = stream.unwrap();
                    let range = range_of(&stream);
                    let number = {
                        let mut log = log.lock().unwrap();
                        log.push(range);
                        log.len() - 1
                    };
                    let (head, body) = script(&served, range, number);
                    // The client may have closed the connection.
                    let _ = write!(stream, "HTTP/1.1 {head}Connection: close\r\n\r\n")
                        .and_then(|()| stream.write_all(&body));
                });
            }
        });
        Self { url, file, asked }
    }

    fn asked(&self) -> Vec<Asked> {
        self.asked.lock().unwrap().clone()
    }

    /// Downloads the file and asserts that it is the served one.
    fn assert_is_fetched(&self, has_known_digest: bool, case: &str) {
        let scratch = tempfile::tempdir().unwrap();
        let into = scratch.path().join("file");
        let request = DownloadRequest {
            url: &self.url,
            into: &into,
            limit: SIZE as u64,
            has_known_digest,
        };
        fetch(&request, &mut |_| true).unwrap_or_else(|error| panic!("{case}: {error}"));
        assert!(fs::read(&into).unwrap() == self.file, "{case}");
        let left = fs::read_dir(scratch.path()).unwrap().count();
        assert_eq!(left, 1, "{case}: nothing else is left");
    }
}

fn range_of(stream: &TcpStream) -> Asked {
    let lines = BufReader::new(stream).lines().map_while(Result::ok);
    let mut found = None;
    for line in lines.take_while(|line| !line.is_empty()) {
        if let Some(range) = line.to_lowercase().strip_prefix("range: bytes=") {
            let (first, last) = range.split_once('-').unwrap();
            let last = last.parse().unwrap_or(SIZE - 1).min(SIZE - 1);
            found = Some((first.parse().unwrap(), last));
        }
    }
    found
}

fn head(first: usize, last: usize, size: usize, more: &str) -> String {
    let length = last + 1 - first;
    format!(
        "206 Partial Content\r\nContent-Length: {length}\r\nContent-Range: bytes {first}-{last}/{size}\r\n{more}"
    )
}

fn whole(file: &[u8]) -> (String, Vec<u8>) {
    let head = format!("200 OK\r\nContent-Length: {}\r\n", file.len());
    (head, file.to_vec())
}

/// Answers as a good server does.
fn good(file: &[u8], asked: Asked, _: usize) -> (String, Vec<u8>) {
    let Some((first, last)) = asked else {
        return whole(file);
    };
    let head = head(first, last, SIZE, "ETag: \"1\"\r\n");
    (head, file[first..=last].to_vec())
}

#[test]
fn ranges_cover_the_file_once() {
    let server = Scripted::start(good);
    server.assert_is_fetched(false, "good server");
    let mut asked = server.asked();
    asked.sort();
    let expected: Vec<Asked> = (0..SIZE)
        .step_by(RANGE)
        .map(|first| Some((first, (first + RANGE).min(SIZE) - 1)))
        .collect();
    assert_eq!(asked, expected);
}

/// Asserts that the file comes in one stream from each of these servers.
fn assert_one_stream(scripts: &[(&str, Script)]) {
    for &(case, script) in scripts {
        for has_known_digest in [true, false] {
            let server = Scripted::start(script);
            server.assert_is_fetched(has_known_digest, case);
            let streams = server
                .asked()
                .iter()
                .filter(|asked| asked.is_none())
                .count();
            assert_eq!(streams, 1, "{case}: {:?}", server.asked());
        }
    }
}

#[test]
fn answers_that_are_not_parts_of_one_file_are_not_put_together() {
    let scripts: [(&str, Script); 4] = [
        (
            "later ranges are answered by the whole file",
            |file, asked, number| {
                if number == 0 {
                    good(file, asked, 0)
                } else {
                    whole(file)
                }
            },
        ),
        ("later ranges start elsewhere", |file, asked, number| {
            let Some((first, last)) = asked.filter(|_| number > 0) else {
                return good(file, asked, number);
            };
            let (first, last) = (first - 7, last - 7);
            (
                head(first, last, SIZE, "ETag: \"1\"\r\n"),
                file[first..=last].to_vec(),
            )
        }),
        ("later ranges are shorter", |file, asked, number| {
            let Some((first, last)) = asked.filter(|_| number > 0) else {
                return good(file, asked, number);
            };
            (
                head(first, last - 9, SIZE, "ETag: \"1\"\r\n"),
                file[first..last - 8].to_vec(),
            )
        }),
        (
            "later ranges are of another version",
            |file, asked, number| {
                let Some((first, last)) = asked.filter(|_| number > 0) else {
                    return good(file, asked, number);
                };
                (
                    head(first, last, SIZE, "ETag: \"2\"\r\n"),
                    vec![0; last + 1 - first],
                )
            },
        ),
    ];
    assert_one_stream(&scripts);
}

#[test]
fn answers_of_another_size_are_not_put_together() {
    let scripts: [(&str, Script); 3] = [
        (
            "later ranges are of a file of another size",
            |file, asked, number| {
                let Some((first, last)) = asked.filter(|_| number > 0) else {
                    return good(file, asked, number);
                };
                (
                    head(first, last, SIZE + 1, "ETag: \"1\"\r\n"),
                    vec![0; last + 1 - first],
                )
            },
        ),
        (
            "later ranges have more bytes than they state",
            |file, asked, number| {
                let Some((first, last)) = asked.filter(|_| number > 0) else {
                    return good(file, asked, number);
                };
                let length = last + 1 - first;
                let mut body = format!("{:x}\r\n", length + 5).into_bytes();
                body.extend(vec![0; length + 5]);
                body.extend(b"\r\n0\r\n\r\n");
                let head = head(first, last, SIZE, "ETag: \"1\"\r\n");
                let stated = format!("Content-Length: {length}\r\n");
                (
                    head.replace(&stated, "Transfer-Encoding: chunked\r\n"),
                    body,
                )
            },
        ),
        ("no range is satisfiable", |file, asked, _| {
            if asked.is_none() {
                return whole(file);
            }
            let head = "416 Range Not Satisfiable\r\nContent-Length: 0\r\n";
            (head.to_owned(), Vec::new())
        }),
    ];
    assert_one_stream(&scripts);
}

#[test]
fn parts_without_version_are_put_together_only_if_the_digest_is_known() {
    let unversioned: Script = |file, asked, _| match asked {
        Some((first, last)) => (head(first, last, SIZE, ""), file[first..=last].to_vec()),
        None => whole(file),
    };
    let server = Scripted::start(unversioned);
    server.assert_is_fetched(false, "no digest");
    assert_eq!(server.asked(), [Some((0, RANGE - 1)), None]);
    let server = Scripted::start(unversioned);
    server.assert_is_fetched(true, "digest");
    assert!(server.asked().len() == 5 && !server.asked().contains(&None));
}

#[test]
fn server_that_refuses_some_connections_gets_fewer() {
    // Of the first four requests, only the first is answered.
    let server = Scripted::start(|file, asked, number| {
        if (1..4).contains(&number) {
            let head = "503 Service Unavailable\r\nContent-Length: 0\r\n";
            return (head.to_owned(), Vec::new());
        }
        good(file, asked, number)
    });
    server.assert_is_fetched(false, "busy server");
    assert_eq!(server.asked().len(), 8, "{:?}", server.asked());
}

#[test]
fn file_that_changed_since_the_interruption_is_downloaded_again() {
    let scratch = tempfile::tempdir().unwrap();
    let into = scratch.path().join("file");
    let breaks_off: Script = |file, asked, number| {
        let (head, mut body) = good(&vec![1; file.len()], asked, number);
        body.truncate(1 << 20);
        (head.replace("\"1\"", "\"0\""), body)
    };
    let server = Scripted::start(breaks_off);
    let fetch_from = |url: &str| {
        let request = DownloadRequest {
            url,
            into: &into,
            limit: SIZE as u64,
            has_known_digest: true,
        };
        fetch(&request, &mut |_| true)
    };
    let error = fetch_from(&server.url).unwrap_err();
    assert!(matches!(error, NnError::Fetch { .. }), "{error}");
    let record = scratch.path().join("file.part.toml");
    let changed = Scripted::start(good);
    let text = fs::read_to_string(&record).unwrap();
    fs::write(&record, text.replace(&server.url, &changed.url)).unwrap();
    fetch_from(&changed.url).unwrap();
    assert!(fs::read(&into).unwrap() == changed.file);
    let is_rest = |asked: &Asked| asked.is_some_and(|(first, _)| first % RANGE == 1 << 20);
    assert!(changed.asked().iter().any(is_rest), "{:?}", changed.asked());
}

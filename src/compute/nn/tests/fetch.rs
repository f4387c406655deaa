use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;

use super::super::{Catalogue, InstallOptions, NnError, check, install};
use super::ready;
use crate::nn::digests::sha256;
use crate::nn::download::{self, DownloadRequest};
use crate::nn::unfinished::{FileVersion, Stretch, Unfinished, UnfinishedPaths};

/// Serves a file over HTTP, with ranges, and returns its address.
///
/// The first answers break off after the given numbers of bytes.
fn serve(file: Vec<u8>, breaks_at: &'static [usize]) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("http://{}/file", listener.local_addr().unwrap());
    std::thread::spawn(move || {
        for (number, stream) in listener.incoming().enumerate() {
            let limit = breaks_at.get(number).copied().unwrap_or(usize::MAX);
            answer(&stream.unwrap(), &file, limit);
        }
    });
    address
}

fn answer(mut stream: &TcpStream, file: &[u8], limit: usize) {
    let mut from = None;
    for line in BufReader::new(stream)
        .lines()
        .map_while(Result::ok)
        .take_while(|line| !line.is_empty())
    {
        let range = line.to_lowercase();
        from = from.or_else(|| {
            range
                .strip_prefix("range: bytes=")?
                .trim_end_matches('-')
                .parse::<usize>()
                .ok()
        });
    }
    let (start, count) = (from.unwrap_or(0), file.len());
    if start >= count {
        write!(
            stream,
            "HTTP/1.1 416 Range Not Satisfiable\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"
        )
        .unwrap();
        return;
    }
    let status = if from.is_some() {
        "206 Partial Content"
    } else {
        "200 OK"
    };
    let range = format!("Content-Range: bytes {start}-{}/{count}\r\n", count - 1);
    let range = if from.is_some() { &*range } else { "" };
    let length = count - start;
    write!(
        stream,
        "HTTP/1.1 {status}\r\nContent-Length: {length}\r\n{range}Connection: close\r\n\r\n"
    )
    .unwrap();
    let _ = stream.write_all(&file[start..count.min(start.saturating_add(limit))]);
}

/// Downloads a file that will be compared with a known digest.
fn fetch(
    url: &str,
    into: &Path,
    limit: u64,
    progress: &mut dyn FnMut(u64) -> bool,
) -> Result<(), NnError> {
    let request = DownloadRequest {
        url,
        into,
        limit,
        has_known_digest: true,
    };
    download::fetch(&request, progress)
}

fn bytes(count: usize) -> Vec<u8> {
    (0..count).map(|at| (at * at % 251) as u8).collect()
}

#[test]
fn interrupted_download_is_resumed() {
    let (file, scratch) = (bytes(100_000), tempfile::tempdir().unwrap());
    let (url, into) = (
        serve(file.clone(), &[40_000, 30_000]),
        scratch.path().join("file"),
    );
    let error = fetch(&url, &into, 1 << 20, &mut |_| true).unwrap_err();
    assert!(
        matches!(
            &error,
            NnError::Fetch {
                is_stopped: false,
                ..
            }
        ),
        "{error}"
    );
    let part = scratch.path().join("file.part");
    assert!(fs::metadata(&part).unwrap().len() == 40_000 && !into.exists());
    fetch(&url, &into, 1 << 20, &mut |_| true).unwrap_err();
    assert_eq!(
        fs::metadata(&part).unwrap().len(),
        70_000,
        "another break loses nothing"
    );
    // Existing bytes are not requested again.
    let mut kept = fs::read(&part).unwrap();
    kept[0] ^= 1;
    fs::write(&part, &kept).unwrap();
    fetch(&url, &into, 1 << 20, &mut |_| true).unwrap();
    let got = fs::read(&into).unwrap();
    assert!(got[0] == file[0] ^ 1 && got[1..] == file[1..] && !part.exists());
}

#[test]
fn download_stops_on_request() {
    let scratch = tempfile::tempdir().unwrap();
    // The server never answers.
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("http://{}/file", listener.local_addr().unwrap());
    let error = fetch(&url, &scratch.path().join("file"), 1 << 20, &mut |_| false).unwrap_err();
    assert!(
        matches!(
            error,
            NnError::Fetch {
                is_stopped: true,
                ..
            }
        ),
        "{error}"
    );
}

fn digest(bytes: &[u8]) -> String {
    let file = tempfile::NamedTempFile::new().unwrap();
    fs::write(file.path(), bytes).unwrap();
    sha256(file.path()).unwrap()
}

#[test]
fn file_that_is_longer_than_expected_is_deleted() {
    let (url, scratch) = (serve(bytes(100_000), &[]), tempfile::tempdir().unwrap());
    let error = fetch(&url, &scratch.path().join("file"), 50_000, &mut |_| true).unwrap_err();
    assert!(
        matches!(
            error,
            NnError::Fetch {
                is_stopped: false,
                ..
            }
        ),
        "{error}"
    );
    assert!(!scratch.path().join("file").exists());
}

fn installed(catalogue: &Catalogue, target: &Path) -> Result<Vec<super::super::Added>, NnError> {
    let options = InstallOptions::default();
    install(catalogue, target, "xfeat", &options, &mut |_| true)
}

fn catalogue(url: &str, sha256: Option<&str>) -> Catalogue {
    let digest = sha256.map_or(String::new(), |digest| format!("sha256 = \"{digest}\"\n"));
    let text = format!(
        "[[entry]]\nname = \"xfeat\"\npurpose = \"p\"\nlicence = \"MIT\"\nsource = \"https://s\"\n[[entry.file]]\n\
         name = \"n.onnx\"\nurl = \"{url}\"\n{digest}"
    );
    Catalogue::parse(&text).unwrap()
}

#[test]
#[ignore = "needs networks (OSTRA_MODELS) and ONNX Runtime (ORT_DYLIB_PATH): add --include-ignored"]
fn network_is_downloaded_verified_and_recorded() {
    let (_, folder) = ready();
    let network = fs::read(folder.join("yolox_nano.onnx")).unwrap();
    let scratch = tempfile::tempdir().unwrap();
    let (url, target) = (serve(network.clone(), &[]), scratch.path().join("models"));
    let wrong = installed(&catalogue(&url, Some("00")), &target).unwrap_err();
    assert!(
        matches!(&wrong, NnError::WrongDownload { .. }) && !target.join("n.onnx").exists(),
        "{wrong}"
    );
    let (good, mut most) = (catalogue(&url, Some(&digest(&network))), 0);
    let options = InstallOptions::default();
    let added = install(&good, &target, "xfeat", &options, &mut |now| {
        assert!(
            now.what.contains("MIT"),
            "the licence is shown: {}",
            now.what
        );
        most = now.bytes.max(most);
        true
    });
    assert!(fs::read(&added.unwrap()[0].path).unwrap() == network && most == network.len() as u64);
    assert!(!target.join("downloads").join("xfeat").exists());
    check(&good, &target, "xfeat").unwrap();
    let spoilt = |path: &Path| {
        let mut bytes = fs::read(path).unwrap();
        *bytes.last_mut().unwrap() ^= 1;
        fs::write(path, bytes).unwrap();
    };
    spoilt(&target.join("n.onnx"));
    let error = check(&good, &target, "xfeat").unwrap_err();
    assert!(matches!(&error, NnError::Changed { .. }), "{error}");
}

#[test]
#[ignore = "needs networks (OSTRA_MODELS) and ONNX Runtime (ORT_DYLIB_PATH): add --include-ignored"]
fn rejected_download_is_not_reused() {
    let (_, folder) = ready();
    let network = fs::read(folder.join("yolox_nano.onnx")).unwrap();
    let scratch = tempfile::tempdir().unwrap();
    let target = scratch.path().join("models");
    let sha256 = digest(&network);
    let from = |file: Vec<u8>| installed(&catalogue(&serve(file, &[]), Some(&sha256)), &target);
    let refused = from(b"<html>There is no such file</html>".to_vec()).unwrap_err();
    assert!(
        !matches!(refused, NnError::Fetch { .. }) && !target.join("n.onnx").exists(),
        "{refused}"
    );
    assert_eq!(
        fs::read(&from(network.clone()).unwrap()[0].path).unwrap(),
        network
    );
}

#[test]
fn error_for_a_network_without_address_tells_how_to_get_it() {
    let scratch = tempfile::tempdir().unwrap();
    let error = install(
        &Catalogue::bundled().unwrap(),
        scratch.path(),
        "superpoint",
        &InstallOptions::default(),
        &mut |_| true,
    )
    .unwrap_err();
    let error = error.to_string();
    assert!(
        error.contains("no address") && error.contains("assets/export/superglue.py"),
        "{error}"
    );
    assert!(
        fs::read_dir(scratch.path()).unwrap().next().is_none(),
        "nothing is left behind"
    );
}

#[test]
fn part_file_without_record_is_downloaded_again() {
    let (file, scratch) = (bytes(5_000), tempfile::tempdir().unwrap());
    let (url, into) = (serve(file.clone(), &[]), scratch.path().join("file"));
    fs::write(scratch.path().join("file.part"), [7; 3_000]).unwrap();
    fetch(&url, &into, 1 << 20, &mut |_| true).unwrap();
    assert_eq!(fs::read(&into).unwrap(), file);
}

#[test]
fn complete_part_file_is_downloaded_again() {
    let (file, scratch) = (bytes(5_000), tempfile::tempdir().unwrap());
    let (url, into) = (serve(file.clone(), &[]), scratch.path().join("file"));
    let paths = UnfinishedPaths::of(&into);
    fs::write(&paths.data, &file).unwrap();
    // The server did not state the size, so that the end is not known to be reached.
    let stretch = Stretch {
        start: 0,
        at: 5_000,
        end: None,
    };
    let record = Unfinished {
        url: url.clone(),
        size: None,
        version: FileVersion::default(),
        stretches: vec![stretch],
    };
    record.write(&paths).unwrap();
    fetch(&url, &into, 1 << 20, &mut |_| true).unwrap();
    assert_eq!(fs::read(&into).unwrap(), file);
}

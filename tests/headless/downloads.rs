//! Tests that only verified downloads are installed and run.
#![cfg(unix)]

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Command, Output};
use std::sync::{Arc, Mutex};

use rcgen::{BasicConstraints, CertificateParams, IsCa, Issuer, KeyPair};
use rustls::pki_types::PrivateKeyDer;
use rustls::{ServerConfig, ServerConnection, StreamOwned};

/// Hosts of the download addresses.
const HOSTS: [&str; 2] = ["github.com", "files.pythonhosted.org"];

/// Returns a site's response to the first line of a request.
type Answer = fn(&str) -> String;

/// A proxy that responds for all sites, with certificates of its own authority.
struct FakeSites {
    proxy: String,
    /// Certificate of the authority in PEM format.
    authority: String,
    /// First line of every request, including those to the proxy.
    requests: Arc<Mutex<Vec<String>>>,
}

impl FakeSites {
    fn start(answer: Answer) -> Self {
        let mut authority = CertificateParams::default();
        authority.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        let authority_key = KeyPair::generate().unwrap();
        let pem = authority.self_signed(&authority_key).unwrap().pem();
        let key = KeyPair::generate().unwrap();
        let certificate = CertificateParams::new(HOSTS.map(String::from))
            .unwrap()
            .signed_by(&key, &Issuer::new(authority, authority_key))
            .unwrap();
        let provider = Arc::new(rustls::crypto::ring::default_provider());
        let config = ServerConfig::builder_with_provider(provider)
            .with_safe_default_protocol_versions()
            .unwrap()
            .with_no_client_auth()
            .with_single_cert(
                vec![certificate.der().clone()],
                PrivateKeyDer::try_from(key.serialize_der()).unwrap(),
            )
            .unwrap();
        let config = Arc::new(config);
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let proxy = format!("http://{}", listener.local_addr().unwrap());
        let requests = Arc::new(Mutex::new(Vec::new()));
        let log = Arc::clone(&requests);
        std::thread::spawn(move || {
            for stream in listener.incoming() {
                // The test checks clients that close the connection early; the server ignores them.
                let _ = serve(stream.unwrap(), &config, &log, answer);
            }
        });
        Self {
            proxy,
            authority: pem,
            requests,
        }
    }

    fn requests(&self) -> Vec<String> {
        self.requests.lock().unwrap().clone()
    }

    /// Runs `ostra models install NAME` in `folder/cwd` and trusts the sites' authority.
    ///
    /// Only the programs in the folders `path` and those of the shell are available.
    fn install(&self, folder: &Path, name: &str, path: &str) -> Output {
        self.install_trusting(&self.authority, folder, name, path)
    }

    fn install_trusting(&self, authority: &str, folder: &Path, name: &str, path: &str) -> Output {
        let (cwd, certificates) = (folder.join("cwd"), folder.join("authority.pem"));
        std::fs::create_dir_all(&cwd).unwrap();
        std::fs::write(&certificates, authority).unwrap();
        let mut command = Command::new(env!("CARGO_BIN_EXE_ostra"));
        command
            .args(["models", "install", name])
            .current_dir(cwd)
            .env("PATH", path);
        command
            .env("XDG_DATA_HOME", folder.join("data"))
            .env("HOME", folder)
            .env_remove("ORT_DYLIB_PATH");
        for other in ["ALL_PROXY", "HTTP_PROXY", "NO_PROXY", "HTTPS_PROXY"] {
            command.env_remove(other).env_remove(other.to_lowercase());
        }
        command
            .env("HTTPS_PROXY", &self.proxy)
            .env("SSL_CERT_FILE", certificates)
            .env_remove("SSL_CERT_DIR");
        command.output().unwrap()
    }
}

/// Serves one connection to the proxy: its own request, or one request through a tunnel.
fn serve(
    stream: TcpStream,
    config: &Arc<ServerConfig>,
    log: &Mutex<Vec<String>>,
    answer: Answer,
) -> std::io::Result<()> {
    let request = read_request(&stream)?;
    log.lock().unwrap().push(request.clone());
    if !request.starts_with("CONNECT ") {
        return (&stream).write_all(answer(&request).as_bytes());
    }
    (&stream).write_all(b"HTTP/1.1 200 OK\r\n\r\n")?;
    let connection = ServerConnection::new(Arc::clone(config)).unwrap();
    let mut tunnel = StreamOwned::new(connection, stream);
    let request = read_request(&mut tunnel)?;
    log.lock().unwrap().push(request.clone());
    tunnel.write_all(answer(&request).as_bytes())?;
    tunnel.conn.send_close_notify();
    tunnel.flush()
}

/// Reads the head of a request and returns its first line.
fn read_request(stream: impl Read) -> std::io::Result<String> {
    let mut lines = BufReader::new(stream).lines();
    let first = lines.next().unwrap_or_else(|| Ok(String::new()))?;
    for line in lines {
        if line?.is_empty() {
            break;
        }
    }
    Ok(first)
}

fn junk(_request: &str) -> String {
    "HTTP/1.1 200 OK\r\nContent-Length: 5\r\nConnection: close\r\n\r\njunk\n".into()
}

fn redirect(to: &str) -> String {
    format!(
        "HTTP/1.1 302 Found\r\nLocation: {to}\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"
    )
}

/// Writes a program `name` that runs a shell script.
fn program(folder: &Path, name: &str, script: &str) {
    let path = folder.join(name);
    std::fs::create_dir_all(folder).unwrap();
    std::fs::write(&path, format!("#!/bin/sh\n{script}\n")).unwrap();
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o755)).unwrap();
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn assert_nothing_is_installed(folder: &Path, name: &str) {
    let installed = std::fs::read_dir(folder.join("data/ostra/models"))
        .unwrap()
        .flatten()
        .filter(|entry| entry.path().is_file())
        .count();
    assert_eq!(installed, 0, "{name}");
}

// Trusted authorities are taken from the environment only on Linux.
#[cfg(target_os = "linux")]
#[test]
fn wrong_file_is_refused_for_every_network_and_the_library() {
    for (name, host) in [
        ("efficient-sam", HOSTS[0]),
        ("yolox", HOSTS[0]),
        ("onnxruntime", HOSTS[1]),
    ] {
        let (folder, sites) = (tempfile::tempdir().unwrap(), FakeSites::start(junk));
        let (bin, mark) = (folder.path().join("bin"), folder.path().join("RAN"));
        for program_name in ["curl", "wget", "python3", "python", "pip", "unzip"] {
            program(
                &bin,
                program_name,
                &format!("echo ran > '{}'", mark.display()),
            );
        }
        let output = sites.install(folder.path(), name, bin.to_str().unwrap());
        let error = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{name}: {error}");
        assert!(error.contains("SHA-256"), "{name}: {error}");
        let requests = sites.requests();
        assert!(
            requests.len() == 2
                && requests[0].starts_with(&format!("CONNECT {host}:443 "))
                && requests[1].starts_with("GET /"),
            "a wrong file is an error, not a reason to try elsewhere: {requests:?}"
        );
        assert_nothing_is_installed(folder.path(), name);
        assert!(!mark.exists(), "no other program does the download");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn redirects_are_followed_only_to_https_addresses() {
    let plain = FakeSites::start(|_| redirect("http://github.com/elsewhere"));
    let folder = tempfile::tempdir().unwrap();
    for name in ["yolox", "onnxruntime"] {
        let output = plain.install(folder.path(), name, "/bin");
        let error = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{name}: {error}");
        assert!(error.contains("only https is allowed"), "{name}: {error}");
        assert_nothing_is_installed(folder.path(), name);
    }
    let requests = plain.requests();
    assert!(
        requests.len() == 4 && !requests.iter().any(|line| line.contains("elsewhere")),
        "{requests:?}"
    );
    let encrypted = FakeSites::start(|request| {
        if request.contains("elsewhere") {
            junk(request)
        } else {
            redirect("https://files.pythonhosted.org/elsewhere")
        }
    });
    let error = stderr(&encrypted.install(folder.path(), "yolox", "/bin"));
    assert!(error.contains("SHA-256"), "{error}");
    assert_nothing_is_installed(folder.path(), "yolox");
}

#[test]
fn nothing_is_requested_from_a_site_with_an_unknown_certificate() {
    let (sites, others) = (FakeSites::start(junk), FakeSites::start(junk));
    let folder = tempfile::tempdir().unwrap();
    for name in ["yolox", "onnxruntime"] {
        let output = sites.install_trusting(&others.authority, folder.path(), name, "/bin");
        let error = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{name}: {error}");
        assert!(error.contains("certificate"), "{name}: {error}");
        assert_nothing_is_installed(folder.path(), name);
    }
    let requests = sites.requests();
    assert!(
        requests.iter().all(|line| !line.starts_with("GET")),
        "{requests:?}"
    );
}

#[test]
fn programs_and_modules_in_the_current_folder_are_not_run() {
    let (folder, sites) = (tempfile::tempdir().unwrap(), FakeSites::start(junk));
    let (bin, cwd) = (folder.path().join("bin"), folder.path().join("cwd"));
    let mark = folder.path().join("HIJACKED");
    for name in ["curl", "python3", "python", "ffmpeg", "ffprobe"] {
        program(&cwd, name, &format!("echo ran > '{}'", mark.display()));
    }
    std::fs::write(
        cwd.join("pip.py"),
        format!("open('{}', 'w')", mark.display()),
    )
    .unwrap();
    std::fs::create_dir_all(&bin).unwrap();
    for path in [
        format!(":.:{}", bin.display()),
        format!("{}:", bin.display()),
        ":".to_owned(),
        "../cwd".to_owned(),
    ] {
        assert_eq!(
            sites.install(folder.path(), "yolox", &path).status.code(),
            Some(1),
            "{path}"
        );
        assert_eq!(
            sites
                .install(folder.path(), "onnxruntime", &path)
                .status
                .code(),
            Some(1),
            "{path}"
        );
        let mut new = Command::new(env!("CARGO_BIN_EXE_ostra"));
        std::fs::write(cwd.join("video.mp4"), "not a video").unwrap();
        let output = new
            .args(["new", "p", "--frames", "video.mp4"])
            .current_dir(&cwd)
            .env("PATH", &path)
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(1));
        assert!(!mark.exists(), "{path}");
    }
}

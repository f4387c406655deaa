//! Tests that only verified downloads are installed and run.
#![cfg(unix)]

use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use sha2::{Digest, Sha256};

use crate::fake_sites::{FakeSites, HOSTS};

fn junk(_request: &str) -> Vec<u8> {
    b"HTTP/1.1 200 OK\r\nContent-Length: 5\r\nConnection: close\r\n\r\njunk\n".to_vec()
}

fn redirect(to: &str) -> Vec<u8> {
    let head = format!(
        "HTTP/1.1 302 Found\r\nLocation: {to}\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"
    );
    head.into_bytes()
}

/// Small networks with the interfaces of public files.
fn public_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/parity/public")
}

/// Responds with the network of the request's last path part.
fn public_file(request: &str) -> Vec<u8> {
    let path = request.split(' ').nth(1).unwrap_or_default();
    let name = path.rsplit('/').next().unwrap_or_default();
    let Ok(file) = std::fs::read(public_folder().join(name)) else {
        return b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"
            .to_vec();
    };
    let length = file.len();
    let mut head =
        format!("HTTP/1.1 200 OK\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n")
            .into_bytes();
    head.extend(file);
    head
}

/// Writes a catalogue that has `mobile-sam` from a public site, with the digests of the small networks.
fn catalogue(folder: &Path) -> PathBuf {
    let file = |name: &str, public: &str, interface: &str| {
        let bytes = std::fs::read(public_folder().join(public)).unwrap();
        let digest: String = Sha256::digest(&bytes)
            .iter()
            .map(|byte| format!("{byte:02x}"))
            .collect();
        format!(
            "[[entry.variant.file]]\nname = '{name}'\nurl = 'https://github.com/sam/releases/{public}'\nbytes = {}\nsha256 = \
             '{digest}'\n{interface}\n",
            bytes.len()
        )
    };
    let text = [
        "[[entry]]\nname = 'mobile-sam'\npurpose = 'masks'\nlicence = 'Apache-2.0'\nsource = 'https://github.com/sam'\n\
         [[entry.variant]]\nname = 'full'\nsummary = 'all'\ndialect = 'sam-hwc'\n",
        &file(
            "mobile-sam-encoder.onnx",
            "encoder-hwc.onnx",
            "inputs = [{ name = 'input_image', element = 'f32', shape = [-1, -1, 3] }]\noutputs = []",
        ),
        &file("mobile-sam-decoder.onnx", "decoder-multi.onnx", ""),
    ]
    .concat();
    let path = folder.join("networks.toml");
    std::fs::write(&path, text).unwrap();
    path
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

/// Installs `mobile-sam` of [`catalogue`] with ONNX Runtime and more environment variables.
#[cfg(target_os = "linux")]
fn install_mobile_sam(sites: &FakeSites, folder: &Path, variables: &[(&str, &str)]) -> Output {
    let mut command = sites.command(&sites.authority, folder, "mobile-sam", "/bin");
    command
        .env("OSTRA_NETWORKS", catalogue(folder))
        .envs(variables.iter().copied());
    if let Some(library) = std::env::var_os("ORT_DYLIB_PATH") {
        command.env("ORT_DYLIB_PATH", library);
    }
    command.output().unwrap()
}

#[cfg(target_os = "linux")]
#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn network_is_installed_through_a_proxy_and_tested() {
    let (folder, sites) = (tempfile::tempdir().unwrap(), FakeSites::start(public_file));
    let output = install_mobile_sam(&sites, folder.path(), &[]);
    let text = String::from_utf8_lossy(&output.stdout).into_owned() + &stderr(&output);
    assert!(output.status.success(), "{text}");
    assert!(text.contains("test passed: IoU of a click"), "{text}");
    assert!(
        text.contains("mobile-sam-encoder.onnx (Apache-2.0)"),
        "{text}"
    );
    let requests = sites.requests();
    assert!(
        requests.len() == 4 && requests[1].starts_with("GET /sam/releases/encoder-hwc.onnx "),
        "{requests:?}"
    );
}

#[cfg(target_os = "linux")]
#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn mirror_replaces_the_public_sites() {
    let (folder, sites) = (tempfile::tempdir().unwrap(), FakeSites::start(public_file));
    let mirror = [("OSTRA_MIRROR", "https://files.pythonhosted.org/nets/")];
    let output = install_mobile_sam(&sites, folder.path(), &mirror);
    assert!(output.status.success(), "{}", stderr(&output));
    for request in sites.requests().chunks(2) {
        assert!(request[0].starts_with("CONNECT files.pythonhosted.org:443 "));
        assert!(request[1].starts_with("GET /nets/github.com/sam/releases/"));
    }
    let plain = [("OSTRA_MIRROR", "http://files.pythonhosted.org")];
    let output = install_mobile_sam(&sites, folder.path(), &plain);
    let error = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{error}");
    assert!(error.contains("OSTRA_MIRROR must be an address"), "{error}");
}

#[cfg(target_os = "linux")]
#[test]
fn machine_without_network_gets_one_clear_line() {
    let (folder, sites) = (tempfile::tempdir().unwrap(), FakeSites::start(junk));
    let nowhere = [("HTTPS_PROXY", "http://127.0.0.1:9")];
    let output = install_mobile_sam(&sites, folder.path(), &nowhere);
    let error = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{error}");
    let lines: Vec<&str> = error
        .lines()
        .filter(|line| line.starts_with("ostra: "))
        .collect();
    assert!(
        lines.len() == 1
            && lines[0].contains("cannot be fetched")
            && lines[0].contains("encoder-hwc.onnx"),
        "{error}"
    );
    assert_nothing_is_installed(folder.path(), "mobile-sam");
}

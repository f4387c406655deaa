//! Nothing unverified is installed or run.
#![cfg(unix)]

use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Command, Output};

/// A program of the name that runs a shell script.
fn program(folder: &Path, name: &str, script: &str) {
    let path = folder.join(name);
    std::fs::create_dir_all(folder).unwrap();
    std::fs::write(&path, format!("#!/bin/sh\n{script}\n")).unwrap();
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o755)).unwrap();
}

/// Runs `ostra models install NAME` in `folder/cwd`, with the programs in `folder/bin` and no others but the shell's.
fn install(folder: &Path, name: &str, path: &str) -> Output {
    let cwd = folder.join("cwd");
    std::fs::create_dir_all(&cwd).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_ostra"));
    command
        .args(["models", "install", name])
        .current_dir(cwd)
        .env("PATH", path);
    command
        .env("XDG_DATA_HOME", folder.join("data"))
        .env("HOME", folder)
        .env_remove("ORT_DYLIB_PATH");
    command.output().unwrap()
}

/// A curl that notes its arguments and writes junk to its output.
const JUNK: &str = "echo \"$*\" >> \"$HOME/curl.log\"; while [ $# -gt 0 ]; do [ \"$1\" = --output ] && o=\"$2\"; shift; done; \
                    echo junk > \"$o\"";

#[test]
fn junk_is_refused_for_every_network_and_the_library() {
    for name in ["efficient-sam", "yolox", "onnxruntime"] {
        let folder = tempfile::tempdir().unwrap();
        let bin = folder.path().join("bin");
        program(&bin, "curl", JUNK);
        let output = install(folder.path(), name, bin.to_str().unwrap());
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{name}: {error}");
        assert!(error.contains("SHA-256"), "{name}: {error}");
        let log = std::fs::read_to_string(folder.path().join("curl.log")).unwrap();
        assert!(
            log.contains("--proto =https --proto-redir =https") && log.starts_with("--disable"),
            "{log}"
        );
        let models = folder.path().join("data/ostra/models");
        let installed = std::fs::read_dir(models)
            .unwrap()
            .flatten()
            .filter(|entry| entry.path().is_file())
            .count();
        assert_eq!(installed, 0, "{name}");
    }
}

#[test]
fn a_package_from_pip_is_verified_before_it_is_used() {
    let folder = tempfile::tempdir().unwrap();
    let bin = folder.path().join("bin");
    program(&bin, "curl", JUNK);
    // Writes junk for the very package that is asked for.
    let pip = "d=; p=; while [ $# -gt 0 ]; do [ \"$1\" = --dest ] && d=\"$2\"; [ \"$1\" = --platform ] && p=\"$2\"; shift; done\n\
               echo junk > \"$d/onnxruntime-1.31.1-cp312-cp312-$p.whl\"; echo ran > \"$HOME/pip.log\"";
    program(&bin, "python3", pip);
    let output = install(folder.path(), "onnxruntime", bin.to_str().unwrap());
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        folder.path().join("pip.log").exists() && output.status.code() == Some(1),
        "{error}"
    );
    assert!(error.contains("SHA-256"), "{error}");
    assert!(
        !folder.path().join("curl.log").exists(),
        "a wrong package is an error, not a reason to try elsewhere"
    );
}

#[test]
fn programs_and_modules_of_the_current_folder_are_not_run() {
    let folder = tempfile::tempdir().unwrap();
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
    program(&bin, "curl", JUNK);
    for path in [
        format!(":.:{}", bin.display()),
        format!("{}:", bin.display()),
        ":".to_owned(),
        "../cwd".to_owned(),
    ] {
        assert_eq!(
            install(folder.path(), "yolox", &path).status.code(),
            Some(1),
            "{path}"
        );
        assert_eq!(
            install(folder.path(), "onnxruntime", &path).status.code(),
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
    // The real python3, where there is one, does not take pip from the current folder.
    let real = ["/usr/bin", "/usr/local/bin"]
        .map(|at| Path::new(at).join("python3"))
        .into_iter()
        .find(|at| at.exists());
    let Some(real) = real else {
        return eprintln!("skipped: no python3");
    };
    // Without an index, so that nothing is fetched.
    program(
        &bin,
        "python3",
        &format!("PIP_NO_INDEX=1 exec {} \"$@\"", real.display()),
    );
    assert_eq!(
        install(folder.path(), "onnxruntime", bin.to_str().unwrap())
            .status
            .code(),
        Some(1)
    );
    assert!(!mark.exists());
}

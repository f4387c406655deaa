//! Structure from motion by learned features, as a user runs it: networks are installed, checked, used and refused.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;
use tempfile::TempDir;

use super::sfm::Project;
use crate::support::{data_dir, models_dir};

/// Frames, networks and ONNX Runtime.
pub(super) struct Needs {
    pub(super) set: PathBuf,
    pub(super) networks: PathBuf,
    pub(super) runtime: PathBuf,
}

impl Needs {
    /// `None`, after a printed line, where something is missing, which is a failure when `CI` is set.
    pub(super) fn find(set: &str) -> Option<Self> {
        let (set, networks) = (data_dir()?.join(set), models_dir()?);
        let named = std::env::var_os("ORT_DYLIB_PATH").filter(|path| !path.is_empty());
        assert!(
            named.is_some() || std::env::var_os("CI").is_none(),
            "ORT_DYLIB_PATH names no ONNX Runtime"
        );
        if named.is_none() {
            eprintln!("skipped: ORT_DYLIB_PATH names no ONNX Runtime");
        }
        Some(Self {
            set,
            networks,
            runtime: named?.into(),
        })
    }
}

/// Runs the program with a data folder of its own; its exit status and both outputs.
pub(super) fn ostra<S: AsRef<OsStr>>(
    data: &Path,
    runtime: Option<&Path>,
    args: &[S],
) -> (Option<i32>, String, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_ostra"));
    command.args(args).env("XDG_DATA_HOME", data);
    match runtime {
        Some(library) => command.env("ORT_DYLIB_PATH", library),
        None => command.env_remove("ORT_DYLIB_PATH"),
    };
    let output = command.output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (
        output.status.code(),
        text(&output.stdout),
        text(&output.stderr),
    )
}

/// The line of a network in the list.
fn listed(data: &Path, name: &str) -> String {
    let (code, out, err) = ostra(data, None, &["models", "list"]);
    assert_eq!(code, Some(0), "{err}");
    let line = out
        .lines()
        .find(|line| line.split_whitespace().next() == Some(name));
    line.unwrap_or_else(|| panic!("{name} is not in the list: {out}"))
        .to_owned()
}

/// What a command says that must fail in one line.
pub(super) fn refused(data: &Path, runtime: Option<&Path>, args: &[&str]) -> String {
    let (code, out, err) = ostra(data, runtime, args);
    assert_eq!(code, Some(1), "{args:?}: {out}{err}");
    assert_eq!(err.trim_end().lines().count(), 1, "{args:?}: {err}");
    err
}

#[test]
fn learned_features_are_refused_until_their_networks_are_there() {
    let Some(set) = data_dir().map(|data| data.join("strecha_fountain_P11")) else {
        return;
    };
    let data = TempDir::new().unwrap();
    let project = Project::new(&set.join("images"), &[]);
    let root = project.root();
    let reconstruct = ["reconstruct", &root, "--method", "sfm"];
    assert!(listed(data.path(), "xfeat").ends_with("not installed"));
    let said = refused(
        data.path(),
        None,
        &[&reconstruct[..], &["--features", "xfeat"]].concat(),
    );
    assert!(
        said.contains("'xfeat' is not installed") && said.contains("ostra models add"),
        "{said}"
    );
    let said = refused(data.path(), None, &["models", "check", "xfeat"]);
    assert!(said.contains("ostra models add xfeat FILE"), "{said}");
    let said = refused(
        data.path(),
        None,
        &[&reconstruct[..], &["--matcher", "lighterglue"]].concat(),
    );
    assert!(
        said.contains("'lighterglue'") && said.contains("features of xfeat"),
        "{said}"
    );
    let said = refused(
        data.path(),
        None,
        &[&reconstruct[..], &["--features", "superpoint"]].concat(),
    );
    assert!(
        said.contains("'superpoint' is not installed") && said.contains("ostra models add"),
        "{said}"
    );
    let said = refused(
        data.path(),
        None,
        &[&reconstruct[..], &["--matcher", "superglue"]].concat(),
    );
    assert!(
        said.contains("superglue-outdoor or superglue-indoor"),
        "{said}"
    );
    assert_eq!(
        project.info()["results"]["cameras"]["frames"]
            .as_u64()
            .unwrap_or(0),
        0
    );
}

#[test]
fn fountain_with_learned_features() {
    let Some(needs) = Needs::find("strecha_fountain_P11") else {
        return;
    };
    let data = TempDir::new().unwrap();
    let run = |args: &[&str]| {
        let (code, out, err) = ostra(data.path(), Some(&needs.runtime), args);
        assert_eq!(code, Some(0), "{args:?}: {out}{err}");
        out + &err
    };
    for network in ["xfeat", "lighterglue"] {
        assert!(listed(data.path(), network).ends_with("not installed"));
        let file = needs.networks.join(format!("{network}.onnx"));
        let said = run(&["models", "add", network, file.to_str().unwrap()]);
        assert!(said.contains("added; it loads"), "{said}");
        let line = listed(data.path(), network);
        assert!(line.contains(data.path().to_str().unwrap()), "{line}");
        let said = run(&["models", "check", network]);
        assert!(said.lines().next().unwrap().ends_with(": fits"), "{said}");
    }

    let project = Project::new(&needs.set.join("images"), &[]);
    let root = project.root();
    let reconstruct = ["reconstruct", &root, "--method", "sfm"];
    let sift = [
        &reconstruct[..],
        &["--features", "sift", "--matcher", "lighterglue"],
    ]
    .concat();
    let said = refused(data.path(), Some(&needs.runtime), &sift);
    assert!(said.contains("choose --features xfeat"), "{said}");

    let learned = [
        "--features",
        "xfeat",
        "--matcher",
        "lighterglue",
        "--max-side",
        "480",
    ];
    let said = run(&[&reconstruct[..], &learned].concat());
    assert!(
        said.contains("11 of 11 frames by xfeat + lighterglue"),
        "{said}"
    );
    assert_eq!(project.placed(), 11);
    let errors = project.errors(&needs.set.join("sparse"));
    let centre = errors
        .pointer("/centre_percent")
        .and_then(Value::as_f64)
        .unwrap();
    println!(
        "fountain, xfeat + lighterglue: {} cameras, centre {centre:.3} %",
        errors["result"]
    );
    assert!(centre <= 0.5);
}

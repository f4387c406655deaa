//! Requirements of tests with networks, and the program with a separate data folder.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::data::{data_dir, models_dir, onnx_runtime};

/// Paths of a data set, the networks and ONNX Runtime.
pub struct Needs {
    pub set: PathBuf,
    pub networks: PathBuf,
    pub runtime: PathBuf,
}

impl Needs {
    /// Returns the requirements of the tests on one data set.
    pub fn of(set: &str) -> Self {
        Self {
            set: data_dir().join(set),
            networks: models_dir(),
            runtime: onnx_runtime(),
        }
    }
}

/// Runs the program with a separate data folder; returns its exit status and both outputs.
pub fn ostra<S: AsRef<OsStr>>(
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

/// Runs a command that must fail with one error line, and returns the line.
pub fn refused(data: &Path, runtime: Option<&Path>, args: &[&str]) -> String {
    let (code, out, err) = ostra(data, runtime, args);
    assert_eq!(code, Some(1), "{args:?}: {out}{err}");
    assert_eq!(err.trim_end().lines().count(), 1, "{args:?}: {err}");
    err
}

//! Paths of real data sets, networks and ONNX Runtime, which are not part of the repository.

use std::path::{Path, PathBuf};

/// Returns the folder of real data sets: `OSTRA_DATA`, by default `../shared/data`.
///
/// # Panics
///
/// If it is missing.
pub fn data_dir() -> PathBuf {
    existing(find_data())
}

/// Returns the folder of network weights: `OSTRA_MODELS`, by default `../shared/models`.
///
/// # Panics
///
/// If it is missing.
pub fn models_dir() -> PathBuf {
    existing(find_models())
}

/// Returns the ONNX Runtime library that `ORT_DYLIB_PATH` names.
///
/// # Panics
///
/// If it is missing.
pub fn onnx_runtime() -> PathBuf {
    existing(find_onnx_runtime())
}

/// Returns the folder of [`data_dir`], or why it cannot be used.
pub fn find_data() -> Result<PathBuf, String> {
    folder("OSTRA_DATA", "../shared/data")
}

/// Returns the folder of [`models_dir`], or why it cannot be used.
pub fn find_models() -> Result<PathBuf, String> {
    folder("OSTRA_MODELS", "../shared/models")
}

/// Returns the library of [`onnx_runtime`], or why it cannot be used.
pub fn find_onnx_runtime() -> Result<PathBuf, String> {
    let path = PathBuf::from(std::env::var_os("ORT_DYLIB_PATH").unwrap_or_default());
    if path.is_file() {
        Ok(path)
    } else {
        Err("ORT_DYLIB_PATH does not name the library of ONNX Runtime".into())
    }
}

fn folder(variable: &str, default: &str) -> Result<PathBuf, String> {
    let given = std::env::var_os(variable).map(PathBuf::from);
    let folder = given.unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join(default));
    if folder.is_dir() {
        Ok(folder)
    } else {
        Err(format!("{} is missing: set {variable}", folder.display()))
    }
}

fn existing(found: Result<PathBuf, String>) -> PathBuf {
    found.unwrap_or_else(|reason| panic!("{reason}"))
}

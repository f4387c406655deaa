//! Tests of `scene/sfm/onnx`.

mod pair;
mod parts;
mod superglue;
mod transport;
mod view;

use std::path::{Path, PathBuf};

use ostra_compute::nn::Runtime;

/// The folder of networks for tests; `None`, after a printed line, where it or ONNX Runtime is missing.
fn networks() -> Option<PathBuf> {
    let folder = given("OSTRA_MODELS", "../../../shared/models")?;
    let found = Runtime::find();
    assert!(
        found.is_ok() || std::env::var_os("CI").is_none(),
        "{}",
        found.unwrap_err()
    );
    found
        .inspect_err(|error| println!("skipped: {error}"))
        .ok()
        .map(|_| folder)
}

/// A folder that a variable names; `None`, after a printed line, where it is missing.
fn given(variable: &str, default: &str) -> Option<PathBuf> {
    let named = std::env::var_os(variable).map(PathBuf::from);
    let folder = named.unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join(default));
    let is_there = folder.is_dir();
    assert!(
        is_there || std::env::var_os("CI").is_none(),
        "{} is missing",
        folder.display()
    );
    if !is_there {
        println!("skipped: {} is missing (set {variable})", folder.display());
    }
    is_there.then_some(folder)
}

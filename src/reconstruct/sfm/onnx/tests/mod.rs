//! Tests of learned features.

mod homography;
mod lightglue;
mod lightglue_reference;
mod pair;
mod parts;
mod superglue;
mod transport;
mod view;

use std::path::{Path, PathBuf};

use ostra_compute::nn::Runtime;

/// Returns the folder of networks for tests.
fn networks() -> PathBuf {
    Runtime::find().unwrap();
    given("OSTRA_MODELS", "../../../shared/models")
}

/// Returns the folder of real data sets.
fn data() -> PathBuf {
    given("OSTRA_DATA", "../../../shared/data")
}

/// Returns the folder that an environment variable names.
fn given(variable: &str, default: &str) -> PathBuf {
    let named = std::env::var_os(variable).map(PathBuf::from);
    let folder = named.unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join(default));
    assert!(folder.is_dir(), "{} is missing", folder.display());
    folder
}

//! Tests of `engine/nn`.

mod catalogue;
mod fetch;
mod install;
mod network;
mod runtime;
mod signature;

use std::path::{Path, PathBuf};

use super::Runtime;

/// The folder of networks for tests.
fn networks() -> PathBuf {
    let named = std::env::var_os("OSTRA_MODELS").map(PathBuf::from);
    let folder = named
        .unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/models"));
    assert!(folder.is_dir(), "{} is missing", folder.display());
    folder
}

/// As [`networks`], with something to run them.
fn ready() -> (Runtime, PathBuf) {
    (Runtime::find().unwrap(), networks())
}

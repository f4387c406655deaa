//! Tests of the module `nn`.

mod catalogue;
mod fetch;
mod install;
mod network;
mod obtain;
mod ranges;
mod runtime;
mod server;
mod signature;

use std::path::{Path, PathBuf};

use super::Runtime;

/// Returns the folder of networks for tests.
fn networks() -> PathBuf {
    let named = std::env::var_os("OSTRA_MODELS").map(PathBuf::from);
    let folder = named
        .unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/models"));
    assert!(folder.is_dir(), "{} is missing", folder.display());
    folder
}

/// Returns ONNX Runtime and the folder of [`networks`].
fn ready() -> (Runtime, PathBuf) {
    (Runtime::find().unwrap(), networks())
}

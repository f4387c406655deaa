//! Tests of `engine/nn`.

mod catalogue;
mod fetch;
mod install;
mod network;
mod runtime;
mod signature;

use std::path::{Path, PathBuf};

use super::Runtime;

/// The folder of networks for tests; `None`, after a printed line, where it is missing, which `CI` does not allow.
fn networks() -> Option<PathBuf> {
    let named = std::env::var_os("OSTRA_MODELS").map(PathBuf::from);
    let folder = named
        .unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/models"));
    let is_there = folder.is_dir();
    assert!(
        is_there || std::env::var_os("CI").is_none(),
        "{} is missing",
        folder.display()
    );
    if !is_there {
        println!(
            "skipped: {} is missing (set OSTRA_MODELS)",
            folder.display()
        );
    }
    is_there.then_some(folder)
}

/// As [`networks`], with something to run them.
fn ready() -> Option<(Runtime, PathBuf)> {
    let folder = networks()?;
    match Runtime::find() {
        Ok(runtime) => Some((runtime, folder)),
        Err(error) => {
            assert!(std::env::var_os("CI").is_none(), "{error}");
            println!("skipped: {error}");
            None
        }
    }
}

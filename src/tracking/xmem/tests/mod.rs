//! Tests of `masks/onnx/xmem`.

mod behaviour;
mod parity;

use std::path::{Path, PathBuf};

use super::XMem;
use ostra_compute::nn::{Network, Runtime};

/// Small networks of random weights with reference answers (`tests/parity/xmem.py` makes them).
fn tiny() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/parity/xmem-tiny")
}

/// The networks of three files in a folder; `None`, after a printed line, where nothing runs networks, which `CI` does not
/// allow.
fn networks(folder: &Path, files: &[String; 3]) -> Option<XMem> {
    let found = Runtime::find();
    assert!(
        found.is_ok() || std::env::var_os("CI").is_none(),
        "{}",
        found.unwrap_err()
    );
    let runtime = found
        .inspect_err(|error| println!("skipped: {error}"))
        .ok()?;
    let load = |file: &String| Network::load(&runtime, &folder.join(file), None).unwrap();
    Some(XMem::new(files.each_ref().map(load)).unwrap())
}

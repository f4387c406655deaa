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

/// The networks of three files in a folder.
fn networks(folder: &Path, files: &[String; 3]) -> XMem {
    let runtime = Runtime::find().unwrap();
    let load = |file: &String| Network::load(&runtime, &folder.join(file), None).unwrap();
    XMem::new(files.each_ref().map(load)).unwrap()
}

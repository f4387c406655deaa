//! Tests of the XMem tracker.

mod behaviour;
mod parity;

use std::path::{Path, PathBuf};

use super::XMem;
use ostra_compute::nn::{Network, Runtime};

/// Folder of small random-weight networks and reference results.
///
/// `tests/parity/xmem.py` creates both.
fn tiny() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/parity/xmem-tiny")
}

/// Loads the three networks from files in a folder.
fn networks(folder: &Path, files: &[String; 3]) -> XMem {
    let runtime = Runtime::find().unwrap();
    let load = |file: &String| Network::load(&runtime, &folder.join(file), None).unwrap();
    XMem::new(files.each_ref().map(load)).unwrap()
}

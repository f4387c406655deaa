//! Tests of `masks/onnx/sam`.

mod errors;
mod parity;
mod prompts;

use std::path::{Path, PathBuf};

use super::Sam;
use ostra_compute::nn::{Network, Runtime};

/// Small networks of random weights with reference answers (`tests/parity/sam.py` makes them).
fn tiny() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/parity/sam-tiny")
}

/// The same with the interface of `EfficientSAM` (`tests/parity/efficient_sam.py`).
fn tiny_efficient() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/parity/efficient-sam-tiny")
}

/// Networks that see flat colours.
fn flat() -> Option<Sam> {
    of_flat_colours("sam-flat")
}

/// The same with the interface of `EfficientSAM`.
fn flat_efficient() -> Option<Sam> {
    of_flat_colours("efficient-sam-flat")
}

fn of_flat_colours(folder: &str) -> Option<Sam> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../tests/parity")
        .join(folder);
    networks(&folder, "encoder.onnx", "decoder.onnx")
}

/// What runs networks; `None`, after a printed line, where it is missing, which `CI` does not allow.
fn runtime() -> Option<Runtime> {
    let found = Runtime::find();
    assert!(
        found.is_ok() || std::env::var_os("CI").is_none(),
        "{}",
        found.unwrap_err()
    );
    found.inspect_err(|error| println!("skipped: {error}")).ok()
}

/// The networks of two files in a folder.
fn networks(folder: &Path, encoder: &str, decoder: &str) -> Option<Sam> {
    let runtime = runtime()?;
    let load = |file: &str| Network::load(&runtime, &folder.join(file), None).unwrap();
    Some(Sam::new(load(encoder), load(decoder)).unwrap())
}

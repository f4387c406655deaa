//! Tests of `masks/onnx/sam`.

mod errors;
mod parity;
mod prompts;

use std::path::{Path, PathBuf};

use super::Sam;
use crate::engine::nn::{Network, Runtime};

/// Small networks of random weights with reference answers (`tests/parity/sam.py` makes them).
fn tiny() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/parity/sam-tiny")
}

/// Networks that see flat colours.
fn flat() -> Option<Sam> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/parity/sam-flat");
    networks(&folder, "encoder.onnx", "decoder.onnx")
}

/// What runs networks; `None`, after a printed line, where it is missing, which `CI` does not allow.
fn runtime() -> Option<Runtime> {
    let found = Runtime::find();
    assert!(found.is_ok() || std::env::var_os("CI").is_none(), "{}", found.unwrap_err());
    found.inspect_err(|error| println!("skipped: {error}")).ok()
}

/// The networks of two files in a folder.
fn networks(folder: &Path, encoder: &str, decoder: &str) -> Option<Sam> {
    let runtime = runtime()?;
    let load = |file: &str| Network::load(&runtime, &folder.join(file), None).unwrap();
    Some(Sam::new(load(encoder), load(decoder)).unwrap())
}

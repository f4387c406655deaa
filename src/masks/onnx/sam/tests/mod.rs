//! Tests of `masks/onnx/sam`.

mod errors;
mod parity;
mod prompts;
mod public;

use std::path::{Path, PathBuf};

use super::Sam;
use ostra_compute::nn::{Dialect, Network, Runtime};

/// Small networks of random weights with reference answers (created by `tests/parity/sam.py`).
fn tiny() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/parity/sam-tiny")
}

/// Same with the interface of `EfficientSAM` (`tests/parity/efficient_sam.py`).
fn tiny_efficient() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/parity/efficient-sam-tiny")
}

/// Same with the interface of Segment Anything 2.1 (`tests/parity/sam2.py`).
fn tiny_sam2() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/parity/sam2-tiny")
}

/// Networks that segment flat colours.
fn flat() -> Sam {
    of_flat_colours("sam-flat", Dialect::Sam)
}

/// Same with the interface of `EfficientSAM`.
fn flat_efficient() -> Sam {
    of_flat_colours("efficient-sam-flat", Dialect::EfficientSam)
}

fn of_flat_colours(folder: &str, dialect: Dialect) -> Sam {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../tests/parity")
        .join(folder);
    networks(dialect, &folder, "encoder.onnx", "decoder.onnx")
}

fn runtime() -> Runtime {
    Runtime::find().unwrap()
}

/// Loads the networks of two files in a folder.
fn networks(dialect: Dialect, folder: &Path, encoder: &str, decoder: &str) -> Sam {
    let runtime = runtime();
    let load = |file: &str| Network::load(&runtime, &folder.join(file), None).unwrap();
    Sam::new(dialect, load(encoder), load(decoder)).unwrap()
}

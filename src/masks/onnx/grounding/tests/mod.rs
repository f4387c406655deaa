//! Tests of `masks/onnx/grounding`.

mod errors;
mod parity;
mod public;

use std::path::{Path, PathBuf};

use super::GroundingDino;
use ostra_compute::nn::{Dialect, Network, Runtime};
use ostra_frames::Image;

/// A small network of random weights with reference answers (by `tests/parity/grounding.py`).
fn tiny() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/parity/grounding-tiny")
}

fn runtime() -> Runtime {
    Runtime::find().unwrap()
}

/// Loads the network in a folder that `tests/parity/grounding.py` wrote.
fn network(folder: &Path, name: &str) -> GroundingDino {
    let network = Network::load(&runtime(), &folder.join(name), None).unwrap();
    let vocabulary = std::fs::read_to_string(folder.join("vocab.txt")).unwrap();
    GroundingDino::new(Dialect::GroundingDino, network, &vocabulary).unwrap()
}

fn image(path: &Path) -> Image {
    let image = image::open(path).unwrap().to_rgb8();
    let pixels = image.pixels().map(|pixel| pixel.0).collect();
    Image {
        width: image.width(),
        height: image.height(),
        pixels,
    }
}

fn phrases(words: &[&str]) -> Vec<String> {
    words.iter().map(|&word| word.to_owned()).collect()
}

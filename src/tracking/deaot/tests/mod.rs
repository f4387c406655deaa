//! Tests of the DeAOT tracker.

mod errors;
mod labels;
mod parity;
mod tracker;

use std::path::{Path, PathBuf};

use super::{Deaot, DeaotOptions};
use crate::propagate::LabelProbabilities;
use ostra_compute::nn::{Network, Runtime};
use ostra_masks::{LabelId, LabelMask};

/// Folder of small random-weight networks and reference results of the official code.
///
/// `tests/parity/deaot.py` creates both.
fn tiny() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/parity/deaot-tiny")
}

/// Finds ONNX Runtime.
fn runtime() -> Runtime {
    Runtime::find().unwrap()
}

/// Loads the four networks from files in a folder.
fn networks(folder: &Path, files: &[String; 4]) -> Deaot {
    let runtime = runtime();
    let load = |file: &String| Network::load(&runtime, &folder.join(file), None).unwrap();
    Deaot::new(files.each_ref().map(load)).unwrap()
}

fn tiny_networks(options: DeaotOptions) -> Deaot {
    let files = ["encoder", "remember", "propagate", "identify"]
        .map(|part| format!("deaot-tiny-{part}.onnx"));
    let mut deaot = networks(&tiny(), &files);
    deaot.options = options;
    deaot
}

/// Returns the most probable label of every pixel.
fn winner(of: &LabelProbabilities) -> LabelMask {
    let pixels = of.width * of.height;
    let labels = [&[LabelId::NONE], of.labels.as_slice()].concat();
    let value = |number: usize, at: usize| of.probabilities[number * pixels + at];
    let best = |at: usize| {
        (1..labels.len()).fold(0, |best, number| {
            if value(number, at) > value(best, at) {
                number
            } else {
                best
            }
        })
    };
    let ids = (0..pixels).map(|at| labels[best(at)]).collect();
    LabelMask {
        width: of.width as u32,
        height: of.height as u32,
        ids,
    }
}

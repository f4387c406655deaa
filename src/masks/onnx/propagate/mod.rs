//! Trackers made of networks that carry masks from one picture to the next: the seam `Propagator`, and what leads one
//! forwards and backwards from anchors and merges both ways.
//!
//! May use: engine::job, frames, the nouns of masks. Must not touch: files, cameras, 3-D, UI.

mod answer;
mod course;
mod merge;
mod pictures;
mod seam;
#[cfg(test)]
mod tests;
mod track;

pub(in crate::masks::onnx) use seam::{Propagated, Propagator};
pub(in crate::masks::onnx) use track::track;

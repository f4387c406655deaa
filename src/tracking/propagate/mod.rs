//! Trackers made of networks that carry masks from one picture to the next: the seam `Propagator`, and what leads one
//! forwards and backwards from anchors and merges both ways.

mod answer;
mod course;
mod merge;
mod pictures;
mod seam;
#[cfg(test)]
mod tests;
mod track;

pub(crate) use seam::{Propagated, Propagator};
pub(crate) use track::track;

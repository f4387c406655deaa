//! Trackers made of networks that carry masks from one picture to the next: the seam `Propagator`, and what leads one
//! forwards and backwards from anchors and merges both ways.

mod answer;
mod pictures;
#[cfg(test)]
mod tests;
mod track;

pub(crate) use answer::{Propagated, Propagator};
pub(crate) use track::track;

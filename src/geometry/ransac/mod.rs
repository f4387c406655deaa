//! Random sample consensus: one loop for every model. A model brings how it is fitted to a few correspondences, what it
//! costs, and how it is refined; same input + seed → same output.
//!
//! May use: rand, pulp. Must not touch: what a model is.

mod consensus;
mod cutoff;
mod sample;
#[cfg(test)]
mod tests;

pub use consensus::{Consensus, Estimator, RansacOptions, consensus};
pub use cutoff::{Cutoff, LANES, within};

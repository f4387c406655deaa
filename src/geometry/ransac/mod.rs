//! Random sample consensus: one loop for every model. A model brings how it is fitted to a few correspondences, what it
//! costs, and how it is refined; same input + seed → same output.

mod consensus;
mod cutoff;
mod sample;
#[cfg(test)]
mod tests;

pub use consensus::{Consensus, Estimator, RansacOptions, consensus};
pub use cutoff::{Cutoff, LANES, within};

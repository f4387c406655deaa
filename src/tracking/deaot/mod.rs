//! DeAOT: up to ten objects are carried from picture to picture at once, seen through what was remembered of earlier
//! ones.
//!
//! Yang, Yang: "Decoupling Features in Hierarchical Propagation for Video Object Segmentation", NeurIPS 2022.

mod network;
mod picture;
#[cfg(test)]
mod tests;
mod tracker;

pub use tracker::{Deaot, DeaotOptions};

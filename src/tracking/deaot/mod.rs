//! The DeAOT tracker: propagates up to ten objects at once from a memory of earlier images.
//!
//! Yang, Yang: "Decoupling Features in Hierarchical Propagation for Video Object Segmentation",
//! NeurIPS 2022.

mod image_input;
mod network;
#[cfg(test)]
mod tests;
mod tracker;

pub use tracker::{Deaot, DeaotOptions};

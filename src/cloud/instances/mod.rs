//! Instances of a label, and unlabelled fragments.
//!
//! Instances are connected components of the points of one label; masks can be split by them.
//! Fragments are unlabelled components that are attached to a labelled object.

mod cluster;
mod hanging;
#[cfg(test)]
mod tests;

pub use cluster::{InstanceOptions, Instances, find_instances, split_mask};
pub use hanging::{HangingPiece, hanging_pieces};

//! Instances of a label, and unlabelled fragments.
//!
//! Instances are connected components of the points of one label; masks can be split by them.
//! Fragments are unlabelled components that are attached to a labelled object.

mod attached_fragments;
mod cluster;
#[cfg(test)]
mod tests;

pub use attached_fragments::{AttachedFragment, attached_fragments};
pub use cluster::{InstanceOptions, Instances, find_instances, split_mask};

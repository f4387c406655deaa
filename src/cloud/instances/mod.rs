//! Instances of a class: points of one label that hang together in space, and the masks that tell them apart. Pieces
//! without a label that hang on a labelled thing.

mod cluster;
mod hanging;
#[cfg(test)]
mod tests;

pub use cluster::{InstanceOptions, Instances, find_instances, split_mask};
pub use hanging::{HangingPiece, hanging_pieces};

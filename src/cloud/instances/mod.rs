//! Instances of a class: points of one label that hang together in space, and the masks that tell them apart. Pieces
//! without a label that hang on a labelled thing.

mod cells;
mod cluster;
mod hanging;
mod options;
mod split_mask;
#[cfg(test)]
mod tests;

pub use cluster::{Instances, find_instances};
pub use hanging::{HangingPiece, hanging_pieces};
pub use options::InstanceOptions;
pub use split_mask::split_mask;

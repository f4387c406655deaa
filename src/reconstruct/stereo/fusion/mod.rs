//! Fusion of complete depths into points with their contributing pixels, which vote on labels
//! (`fuse::vote_onto`).

mod cloud;
mod fuse;

pub use cloud::{Contributor, DenseCloud, FusedView};
pub use fuse::{FusionOptions, FusionRequest, fuse_depths};

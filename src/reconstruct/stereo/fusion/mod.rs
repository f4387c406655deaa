//! Complete depths → points with the pixels that made them, which vote on labels (`fuse::vote_onto`).

mod cloud;
mod fuse;

pub use cloud::{Contributor, DenseCloud, FusedView};
pub use fuse::{FusionOptions, fuse_depths};

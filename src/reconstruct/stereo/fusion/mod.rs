//! Complete depths → points with the pixels that made them, which vote on labels (`fuse::vote_onto`).

mod cloud;
mod options;
mod points;
mod run;

pub use cloud::{Contributor, DenseCloud, FusedView};
pub use options::FusionOptions;
pub use run::fuse_depths;

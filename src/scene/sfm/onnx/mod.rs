//! Learned features: keypoints and matches from networks.
//!
//! May use: engine::nn, glam, rayon; of `sift` what tells bars beside a picture. Must not touch: files, cameras.

mod heat;
mod lighterglue;
mod prepared;
mod sampled;
mod xfeat;

#[cfg(test)]
mod tests;

pub use lighterglue::{LighterGlue, LighterGlueOptions};
pub use xfeat::{XFeat, XFeatOptions};

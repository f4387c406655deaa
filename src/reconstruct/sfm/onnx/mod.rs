//! Learned features: keypoints and matches from networks.

mod heat;
mod keypoints;
mod lighterglue;
mod superglue;
mod superpoint;
mod xfeat;

#[cfg(test)]
mod tests;

pub use lighterglue::{LighterGlue, LighterGlueOptions};
pub use superglue::{SuperGlue, SuperGlueOptions};
pub use superpoint::{SuperPoint, SuperPointOptions};
pub use xfeat::{XFeat, XFeatOptions};

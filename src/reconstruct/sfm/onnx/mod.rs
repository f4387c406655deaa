//! Learned features: keypoints and matches from networks.

mod aliked;
mod heat;
mod keypoints;
mod lighterglue;
mod lightglue;
mod superglue;
mod superpoint;
mod xfeat;

#[cfg(test)]
mod tests;

pub use aliked::{Aliked, AlikedOptions};
pub use lighterglue::{LighterGlue, LighterGlueOptions};
pub use lightglue::{LightGlue, LightGlueFeatures, LightGlueOptions};
pub use superglue::{SuperGlue, SuperGlueOptions};
pub use superpoint::{SuperPoint, SuperPointOptions};
pub use xfeat::{XFeat, XFeatOptions};

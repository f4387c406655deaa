//! SIFT: scale- and turn-invariant keypoints with their descriptors (Lowe, "Distinctive Image Features from
//! Scale-Invariant Keypoints", IJCV 2004).

mod blur;
mod borders;
mod descriptor;
mod extract;
mod extrema;
mod gradient;
mod kernel;
mod keypoint;
mod octave;
mod options;
mod orientation;
mod pyramid;
mod refine;
mod rows;
mod shrink;
mod strongest;

pub(super) use borders::Content;
pub use extract::extract_sift;
pub use keypoint::{SiftFeatures, SiftKeypoint};
pub use options::SiftOptions;

#[cfg(test)]
mod tests;

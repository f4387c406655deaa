//! SIFT: scale- and rotation-invariant keypoints with their descriptors (Lowe, "Distinctive Image
//! Features from Scale-Invariant Keypoints", IJCV 2004).

mod blur;
mod descriptor;
mod extractor;
mod extrema;
mod keypoint;
mod octave;
mod orientation;
mod refine;
mod rows;

pub(super) use extractor::Content;
pub use extractor::{Sift, extract_sift};
pub use keypoint::{SiftFeatures, SiftKeypoint, SiftOptions};

#[cfg(test)]
mod tests;

//! Matching of keypoints of two images by nearest descriptors, found cell by cell.

mod cells;
mod centres;
mod nearest;
#[cfg(test)]
mod tests;
mod tile;

pub(super) use centres::{Value, k_means, nearest_centres};
pub use nearest::NearestMatcher;

//! Which keypoints of two pictures show the same point: nearest descriptors, found cell by cell.

mod cells;
mod centres;
mod lanes;
mod nearest;
mod record;
#[cfg(test)]
mod tests;
mod value;

pub(super) use centres::{k_means, nearest_centres};
pub use nearest::NearestMatcher;
pub(super) use value::Value;

//! Which keypoints of two pictures show the same point: nearest descriptors, found exactly.

mod lanes;
mod nearest;
mod record;
mod scan;
mod sketch;
#[cfg(test)]
mod tests;
mod value;

pub(super) use lanes::{LANES, ROWS, tile};
pub use nearest::NearestMatcher;
pub(super) use value::Value;

//! The segmenter `geometry`: selects objects by their connectivity in 3-D.
//!
//! Surfaces seen by several frames are partitioned in many ways. The answer to a click is the one
//! that most partitions agree on. [`FittingSegmenter`] takes it for solid objects and leaves
//! everything else to the segmenter for single images.

mod fitting;
mod frame;
mod segmentation;
mod segmenter;
mod surfaces;
mod tree;
mod voxels;

pub use fitting::{BOX, FittingSegmenter, unfit};
pub use segmenter::GeometrySegmenter;

#[cfg(test)]
mod tests;

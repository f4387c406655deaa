//! The segmenter `geometry`: selects objects by their connectivity in 3-D.
//!
//! Surfaces seen by several frames are partitioned in many ways. The answer to a click is the one
//! that most partitions agree on.

mod frame;
mod segmentation;
mod segmenter;
mod surfaces;
mod tree;
mod voxels;

pub use segmenter::GeometrySegmenter;

#[cfg(test)]
mod tests;

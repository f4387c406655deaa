//! What hangs together in space: the surfaces that several frames see, parted in many ways, and the segmenter
//! `geometry` that takes a thing by what most of those ways agree on.

mod frame;
mod segmentation;
mod segmenter;
mod surfaces;
mod tree;
mod voxels;

pub use segmenter::GeometrySegmenter;

#[cfg(test)]
mod tests;

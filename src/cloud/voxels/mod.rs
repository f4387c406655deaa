//! Conversion of a cloud to voxels.
//!
//! The voxels are those that hold points and, optionally, those they enclose. Their outer faces can
//! be extracted for rendering.

mod bits;
mod carve;
mod interior;
mod occupied;
#[cfg(test)]
mod tests;

pub use interior::fill_interior;
pub use occupied::{voxel_faces, voxelize};

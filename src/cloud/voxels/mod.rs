//! A cloud → cubes that people can count: those that hold its points, on request what they enclose, and their faces.

mod bits;
mod carve;
mod interior;
mod occupied;
#[cfg(test)]
mod tests;

pub use interior::fill_interior;
pub use occupied::{voxel_faces, voxelize};

//! A cloud → cubes that people can count: those that hold its points, on request what they enclose, and their faces.

mod bits;
mod faces;
mod free;
mod interior;
mod occupied;
#[cfg(test)]
mod tests;
mod walls;

pub use faces::voxel_faces;
pub use interior::fill_interior;
pub use occupied::voxelize;

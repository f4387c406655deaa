//! Points from where several cameras see them.

mod position;
mod robust;
#[cfg(test)]
mod tests;

pub use position::{Sighting, largest_angle, triangulate};
pub use robust::{Triangulated, TriangulationOptions, triangulate_robust};

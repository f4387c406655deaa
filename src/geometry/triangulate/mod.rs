//! Points from where several cameras see them.
//!
//! May use: solvers. Must not touch: threads of its own, files.

mod position;
mod robust;
#[cfg(test)]
mod tests;

pub use position::{Sighting, largest_angle, triangulate};
pub use robust::{Triangulated, TriangulationOptions, triangulate_robust};

//! Minimal solvers, one pure function per file.
//!
//! A minimal solver takes the fewest correspondences that determine a model and returns all models
//! that satisfy them. Rays are points on the plane z = 1 of camera space, without lens distortion.

mod eight_point;
mod five_point;
mod homography;
mod least_squares;
mod null_space;
mod p3p;
mod real_roots;
mod seven_point;
#[cfg(test)]
mod tests;

pub use eight_point::eight_point;
pub use five_point::five_point;
pub use homography::{homography, homography4};
pub(super) use least_squares::{Linearised, Problem, minimise};
pub use p3p::p3p;
pub use seven_point::seven_point;

//! Cameras, poses, alignment: same input + seed → same output.
//!
//! May use: nalgebra, glam. Must not touch: pixels' values, files, threads of its own, clocks, logging.

mod camera;
mod error;
mod pose;

pub use camera::{Camera, Distortion};
pub use error::GeometryError;
pub use pose::Pose;

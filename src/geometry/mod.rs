//! Cameras, poses, alignment: same input + seed → same output.
//!
//! May use: nalgebra, glam. Must not touch: pixels' values, files, threads of its own, clocks, logging.

mod align;
mod camera;
mod distortion;
mod error;
mod pose;
mod trajectory;
mod turn;

pub use align::{Alignment, Similarity};
pub use camera::Camera;
pub use distortion::Distortion;
pub use error::GeometryError;
pub use pose::Pose;
pub use trajectory::{ErrorStatistics, TrajectoryError};
pub use turn::Turn;

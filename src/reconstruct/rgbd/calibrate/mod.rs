//! Detection of images that are not aligned with their depths, and calibration of their camera.

mod calibration;
mod pairs;
mod parallax;

pub use calibration::{Calibration, calibrate};

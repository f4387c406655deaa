//! Whether a recording's pictures lie on its depths, and the pictures' camera where they do not.

mod calibration;
mod pairs;
mod parallax;

pub use calibration::{Calibration, calibrate};

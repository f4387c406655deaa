//! Whether a recording's pictures lie on its depths, and the pictures' camera where they do not.

mod fit;
mod pairs;
mod parallax;
mod run;

pub use run::{Calibration, calibrate};

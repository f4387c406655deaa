//! Whether a recording's pictures lie on its depths, and the pictures' camera where they do not.
//!
//! May use: views, pyramids and links of scene::rgbd, frames, geometry. Must not touch: Project, UI.

mod fit;
mod pairs;
mod parallax;
mod run;

pub use run::{Calibration, calibrate};

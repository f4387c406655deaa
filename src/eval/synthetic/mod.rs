//! Synthetic scenes with exact colour, depth, cameras, labels and traits, made from a seed.
//!
//! They serve the demo, tests and users who want to measure the accuracy of results.

mod bricks;
mod culm;
mod material;
mod mesh;
mod model;
mod noise;
mod options;
mod panicle;
mod posters;
mod raster;
mod render;
mod scene;
#[cfg(test)]
mod tests;
mod tiller;
mod truth;
mod view;
mod write;

pub use options::{SceneKind, SceneOptions, SensorNoise, ViewPath};
pub use scene::Scene;
pub use truth::TruthOptions;
pub use view::{RenderedView, SyntheticView};

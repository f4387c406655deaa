//! A scene made from a seed, with exact colour, depth, cameras, labels and traits: for the demo, for tests, for whoever
//! wants to see how far results can be trusted.

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

pub use options::{SceneKind, SceneOptions, SensorNoise};
pub use scene::Scene;
pub use truth::TruthOptions;
pub use view::{RenderedView, View};

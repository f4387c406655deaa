//! A scene made from a seed, with exact colour, depth, cameras, labels and traits: for the demo, for tests, for whoever
//! wants to see how far results can be trusted.

mod bitmap;
mod blade;
mod bricks;
mod culm;
mod curve;
mod dice;
mod light;
mod material;
mod mesh;
mod model;
mod noise;
mod options;
mod panicle;
mod part;
mod posters;
mod pot;
mod raster;
mod render;
mod sampling;
mod scene;
mod sensor;
#[cfg(test)]
mod tests;
mod tiller;
mod tiller_traits;
mod toy;
mod truth;
mod view;
mod visibility;
mod write;

pub use options::{SceneKind, SceneOptions, SensorNoise};
pub use scene::Scene;
pub use truth::TruthOptions;
pub use view::{RenderedView, View};

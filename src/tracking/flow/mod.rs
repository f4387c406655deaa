//! The tracker that needs neither weights nor geometry: masks carried by optical flow, kept right by what each object
//! looks like, where it is expected and how it moves, and by what keyframes showed where a network computes features.
//!
//! Works on pictures reduced to a bounded size. Positions here are pixel indices: the centre of the top-left pixel is
//! (0, 0).

mod cells;
mod change;
mod dis;
mod evidence;
mod locate;
mod memory;
mod motion;
mod moving_regions;
mod object;
mod objects;
mod options;
mod picture;
mod plane;
#[cfg(test)]
mod tests;
mod tracker;
mod variational;
mod votes;

pub use memory::{DenseFeatures, FeatureMap};
pub use moving_regions::moving_apart;
pub use options::FlowOptions;
pub use tracker::FlowTracker;

//! A tracker based on optical flow that needs neither network weights nor depth.
//!
//! Optical flow transfers the masks from frame to frame. Appearance, expected position and motion
//! of each object correct them. If a network computes dense features, the keyframes' features count
//! as well.
//!
//! The tracker works on images reduced to a bounded size. Positions are pixel indices: the centre
//! of the top-left pixel is (0, 0).

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
mod plane;
#[cfg(test)]
mod tests;
mod tracked_image;
mod tracker;
mod variational;
mod votes;

pub use memory::{DenseFeatures, FeatureMap};
pub use moving_regions::moving_apart;
pub use options::FlowOptions;
pub use tracker::FlowTracker;

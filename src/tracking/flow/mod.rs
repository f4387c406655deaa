//! The tracker that needs neither weights nor geometry: masks carried by optical flow, kept right by what each object
//! looks like, where it is expected and how it moves, and by what anchors showed where something describes pictures.
//!
//! Works on pictures reduced to a bounded size. Positions here are pixel indices: the centre of the top-left pixel is
//! (0, 0).

mod apart;
mod cells;
mod colors;
mod dis;
mod evidence;
mod flows;
mod locate;
mod memory;
mod motion;
mod object;
mod options;
mod picture;
mod plane;
#[cfg(test)]
mod tests;
mod tracker;
mod variational;
mod votes;
mod walk;

pub use apart::moving_apart;
pub use memory::{Describer, Description};
pub use options::FlowOptions;
pub use tracker::FlowTracker;

//! Any tracker's masks held against the anchors' masks carried through geometry: what contradicts is mended, and an
//! object that strayed is given to the tracker anew.

mod hold;
mod tracker;
mod walk;

pub use hold::ConstrainOptions;
pub use tracker::ConstrainedTracker;

//! Any tracker's masks held against the anchors' masks carried through geometry: what contradicts is mended, and an
//! object that strayed is given to the tracker anew.

mod account;
mod ahead;
mod contradiction;
mod hold;
mod judge;
mod options;
mod run;
mod spread;
mod tracker;
mod walk;

pub use options::ConstrainOptions;
pub use tracker::ConstrainedTracker;

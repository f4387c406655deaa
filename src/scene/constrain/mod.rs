//! Any tracker's masks held against the anchors' masks carried through geometry: what contradicts is mended, and an
//! object that strayed is given to the tracker anew.
//!
//! May use: scene::carry, scene::doubt, masks, frames, engine::job. Must not touch: files, Project, UI.

mod account;
mod ahead;
mod contradiction;
mod hold;
mod judge;
mod options;
mod run;
mod spread;
#[cfg(test)]
mod tests;
mod tracker;
mod walk;

pub use options::ConstrainOptions;
pub use tracker::ConstrainedTracker;

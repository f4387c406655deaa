//! Masks carried through geometry: the `geometry` tracker for frames with depth and cameras.
//!
//! May use: masks, frames, geometry, engine::job. Must not touch: files, Project, UI.

mod anchor;
mod bleed;
mod choose;
mod complete;
mod decide;
mod draw;
mod lookup;
mod options;
mod pixel_box;
mod ready;
mod refine;
mod run;
mod sightings;
mod smooth;
mod tolerance;
mod tracker;
mod viewpoint;
mod views;
mod vote;

pub use options::CarryOptions;
pub use tracker::GeometryTracker;

#[cfg(test)]
mod tests;

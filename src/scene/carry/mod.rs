//! Masks carried through geometry: the `geometry` tracker for frames with depth and cameras.
//!
//! May use: masks, frames, geometry, engine::job. Must not touch: files, Project, UI.

mod anchor;
mod choose;
mod complete;
mod draw;
mod lookup;
mod options;
mod pixel_box;
mod refine;
mod sightings;
mod smooth;
mod target;
mod tolerance;
mod tracker;
mod viewpoint;
mod views;
mod vote;

pub use options::CarryOptions;
pub use tracker::GeometryTracker;

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
mod testimony;
mod tolerance;
mod tracker;
mod viewpoint;
mod views;
mod vote;
mod witnesses;

pub use options::CarryOptions;
pub(super) use testimony::Testimony;
pub use tracker::GeometryTracker;
pub(super) use views::Views;
pub(super) use witnesses::Witnesses;

#[cfg(test)]
mod tests;

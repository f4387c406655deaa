//! Masks carried through geometry: the `geometry` tracker for frames with depth and cameras.

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

pub(super) use choose::fillers_for;
pub(super) use complete::Completion;
pub use options::CarryOptions;
pub(super) use pixel_box::PixelBox;
pub(super) use refine::{belonging, passing};
pub(super) use testimony::Testimony;
pub(super) use tolerance::Tolerance;
pub use tracker::GeometryTracker;
#[cfg(test)]
pub(super) use viewpoint::Stand;
pub(super) use viewpoint::Viewpoint;
pub(super) use views::Views;
#[cfg(test)]
pub(super) use views::rays_of;
pub(super) use witnesses::Witnesses;

#[cfg(test)]
mod tests;

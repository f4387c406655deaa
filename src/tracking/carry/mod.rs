//! Masks carried through geometry: the `geometry` tracker for frames with depth and cameras.

mod anchor;
mod bleed;
mod decide;
mod draw;
mod options;
mod tracker;
mod viewpoint;
mod vote;
mod witnesses;

pub(super) use anchor::fillers_for;
pub(super) use decide::{belonging, passing};
pub(super) use draw::Completion;
pub use options::CarryOptions;
pub(super) use options::Tolerance;
pub use tracker::GeometryTracker;
pub(super) use viewpoint::{PixelBox, Viewpoint, Views};
#[cfg(test)]
pub(super) use viewpoint::{Stand, rays_of};
pub(super) use witnesses::{Testimony, Witnesses};

#[cfg(test)]
mod tests;

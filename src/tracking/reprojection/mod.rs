//! The `geometry` tracker: re-projects masks between frames with depth and cameras.

mod decide;
mod depth_leak;
mod depth_view;
mod draw;
mod keyframe;
mod keyframe_views;
mod options;
mod tracker;
mod vote;

pub(super) use decide::{edge_affinity, label_scores};
#[cfg(test)]
pub(super) use depth_view::{CalibratedView, rays_of};
pub(super) use depth_view::{DepthView, DepthViews, PixelBox};
pub(super) use draw::DepthCompletion;
pub(super) use keyframe::fillers_for;
pub(super) use keyframe_views::KeyframeViews;
pub use options::ReprojectionOptions;
pub(super) use options::Tolerance;
pub use tracker::GeometryTracker;
pub(super) use vote::ReprojectedLabels;

#[cfg(test)]
mod tests;

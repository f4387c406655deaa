//! Trackers, which carry masks from keyframes to the other frames: optical flow ([`flow`]), networks ([`xmem`], [`deaot`]),
//! re-projection through depth and cameras ([`carry`]), and any tracker held against the geometry ([`constrain`]). The
//! geometry segmenter ([`bodies`]) stands here because it shares re-projection's rays and borders.

pub mod bodies;
pub mod carry;
pub mod constrain;
pub mod deaot;
pub mod flow;
mod propagate;
mod xfeat;
pub mod xmem;

pub use bodies::GeometrySegmenter;
pub use carry::{CarryOptions, GeometryTracker};
pub use constrain::{ConstrainOptions, ConstrainedTracker};
pub use xfeat::XFeatCells;

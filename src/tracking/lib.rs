//! Trackers, which carry masks from keyframes to the other frames: optical flow ([`flow`]), networks ([`xmem`], [`deaot`]),
//! re-projection through depth and cameras ([`reprojection`]), and any tracker whose masks are checked against geometry
//! ([`geometric_consistency`]). Flow and the networks are led through the frames by one driver (`propagate`). The geometry
//! segmenter ([`supervoxels`]) stands here because it shares re-projection's rays and borders.

pub mod deaot;
pub mod flow;
pub mod geometric_consistency;
mod networks;
mod propagate;
pub mod reprojection;
pub mod supervoxels;
mod xfeat;
pub mod xmem;

pub use geometric_consistency::{ConsistencyOptions, ConsistencyTracker};
pub use reprojection::{GeometryTracker, ReprojectionOptions};
pub use supervoxels::GeometrySegmenter;
pub use xfeat::XFeatCells;

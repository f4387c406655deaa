//! Where a camera stood that sees known points.

mod estimate;
mod focal;
mod refine;
mod seen;
mod slope;
#[cfg(test)]
mod tests;

pub use estimate::{AbsolutePose, AbsolutePoseOptions, estimate_absolute_pose};
pub use focal::estimate_absolute_pose_and_focal;
pub use refine::refine_absolute_pose;
pub(super) use slope::pixel_slope;

//! Absolute pose: estimates the pose of a camera from known points that it sees.

mod estimate;
mod refine;
mod seen;
#[cfg(test)]
mod tests;

pub use estimate::{
    AbsolutePose, AbsolutePoseOptions, estimate_absolute_pose, estimate_absolute_pose_and_focal,
};
pub use refine::refine_absolute_pose;

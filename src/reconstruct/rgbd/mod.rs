//! RGB-D recordings without cameras → cameras: odometry, loops, pose graph, and the account of what was left out.

mod align;
mod calibrate;
mod error;
mod graph;
mod join;
mod link;
mod odometry;
mod pyramid;
pub mod register;
mod register_rgbd;
mod scan;
#[cfg(test)]
mod tests;
mod view;

pub use calibrate::{Calibration, calibrate};
pub use error::RgbdError;
pub use join::RgbdOptions;
pub use link::{FrameLink, LinkKind};
pub use odometry::OnPose;
pub use register_rgbd::{RgbdRequest, RgbdResult, register_rgbd};

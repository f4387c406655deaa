//! Registration of RGB-D recordings without cameras: odometry, loops, pose graph, and a report per
//! frame.
//!
//! There is one pose graph over all frames, not one per fragment and another over fragments. A link
//! is two views that were aligned by depth and brightness and then agree in both, each as the other
//! sees it. The other links may switch it off. A fragment is a set of frames that links connect.
//! Further fragments are registered to the largest one by shape, and kept only if frames of both
//! agree. Once poses are known, more links are made where they show overlap.

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
mod rgbd_image;
mod scan;
#[cfg(test)]
mod tests;

pub use calibrate::{Calibration, calibrate};
pub use error::RgbdError;
pub use join::RgbdOptions;
pub use link::{FrameLink, LinkKind};
pub use odometry::OnPose;
pub use register_rgbd::{RgbdRequest, RgbdResult, planned_stages, register_rgbd};

//! RGB-D recordings without cameras → cameras: odometry, loops, pose graph, and the account of what was left out.

mod account;
mod agreement;
mod align;
mod between;
mod calibrate;
mod chain;
mod error;
mod forest;
mod fragment;
mod graph;
mod join;
mod link;
mod odometry;
mod options;
mod overlap;
mod pyramid;
pub mod register;
mod run;
mod scan;
#[cfg(test)]
mod tests;
mod view;

pub use calibrate::{Calibration, calibrate};
pub use chain::OnPose;
pub use error::RgbdError;
pub use link::{FrameLink, LinkKind};
pub use options::RgbdOptions;
pub use run::{RgbdRequest, RgbdResult, register_rgbd};

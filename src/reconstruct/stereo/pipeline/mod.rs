//! Stereo over all views: choice of sources, rounds, filtering and completion; bounded memory, stop
//! and resume per view.

mod estimate;
mod images;
mod outcome;
mod plan;
mod prepared;

pub use estimate::{StereoOptions, estimate_depths, planned_stages};
pub use outcome::ViewOutcome;
pub use plan::{RasterMask, StereoRequest};

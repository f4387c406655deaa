//! Views through stereo: what is compared with what, rounds over all views, filtering and completion; bounded memory, stop and resume
//! per view.

mod outcome;
mod pictures;
mod plan;
mod run;
mod store;
mod work;

pub use outcome::ViewOutcome;
pub use run::{RasterMask, StereoOptions, StereoRequest, estimate_depths};
pub use store::{DepthStore, MemoryDepths, Stage};

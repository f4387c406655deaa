//! A wrapper that checks any tracker's masks against re-projected keyframe masks.
//!
//! Contradictions are corrected. If an object has drifted, the tracker restarts from the corrected
//! mask.

mod check_mask;
mod checked_pass;
mod tracker;

pub use check_mask::ConsistencyOptions;
pub use tracker::ConsistencyTracker;

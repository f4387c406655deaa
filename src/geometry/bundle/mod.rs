//! Bundle adjustment: cameras, poses and points moved together until their reprojection errors are least.
//!
//! After B. Triggs, P. McLauchlan, R. Hartley, A. Fitzgibbon, *Bundle Adjustment — A Modern Synthesis*, Vision
//! Algorithms 1999: Levenberg–Marquardt, the points eliminated first (Schur complement), the rest factored in blocks.

mod adjust;
mod arrange;
mod groups;
mod lens;
mod linearise;
mod normal;
mod options;
mod piece;
mod point;
mod problem;
mod state;
mod trial;

#[cfg(test)]
mod tests;

pub use adjust::adjust;
pub use options::{BundleOptions, BundleSummary, Loss, Refine};
pub use problem::{Bundle, BundleImage, BundleObservation};

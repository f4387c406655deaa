//! Bundle adjustment: cameras, poses and points moved together until their reprojection errors are least.
//!
//! After B. Triggs, P. McLauchlan, R. Hartley, A. Fitzgibbon, *Bundle Adjustment — A Modern Synthesis*, Vision
//! Algorithms 1999: Levenberg–Marquardt, the points eliminated first (Schur complement), the rest factored in blocks.

mod adjust;
mod arrange;
mod layout;
mod lens;
mod linearise;
mod normal;
mod problem;
mod state;

#[cfg(test)]
mod tests;

pub use adjust::adjust;
pub use problem::{
    Bundle, BundleImage, BundleObservation, BundleOptions, BundleSummary, Loss, Refine,
};

//! Bundle adjustment: cameras, poses and points moved together until their reprojection errors are least.
//!
//! After B. Triggs, P. McLauchlan, R. Hartley, A. Fitzgibbon, *Bundle Adjustment — A Modern Synthesis*, Vision
//! Algorithms 1999: Levenberg–Marquardt, the points eliminated first (Schur complement), the rest factored in blocks.
//!
//! The only part of this crate that uses rayon. Sums keep a fixed order, so that the result is the same for any number of threads.

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

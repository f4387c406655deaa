//! Bundle adjustment: minimises reprojection errors over cameras, poses and points.
//!
//! After B. Triggs, P. McLauchlan, R. Hartley, A. Fitzgibbon, *Bundle Adjustment — A Modern
//! Synthesis*, Vision Algorithms 1999: Levenberg–Marquardt with the points eliminated first (Schur
//! complement) and the rest factored in blocks.
//!
//! This is the only part of the crate that uses rayon. Sums are in a fixed order, so that the
//! result is the same for any number of threads.

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

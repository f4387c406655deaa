//! Two-view geometry: the motion between two images and the matches that agree with it.

mod estimate;
mod matched;
mod models;
mod refine;
#[cfg(test)]
mod tests;

pub use estimate::{TwoView, TwoViewKind, TwoViewOptions, estimate_two_view};

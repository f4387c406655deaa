//! Two views: which matches agree with one motion of the camera, and which motion that is.

mod estimate;
mod matched;
mod models;
mod refine;
#[cfg(test)]
mod tests;

pub use estimate::{TwoView, TwoViewKind, TwoViewOptions, estimate_two_view};

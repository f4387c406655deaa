//! Two views: which matches agree with one motion of the camera, and which motion that is.

mod estimate;
mod in_front;
mod matched;
mod models;
mod options;
mod refine;
mod support;
#[cfg(test)]
mod tests;

pub use estimate::estimate_two_view;
pub use options::{TwoView, TwoViewKind, TwoViewOptions};

//! Features of simulated tilted views, for images taken at a grazing angle to the content of
//! others.

mod merge;
#[cfg(test)]
mod tests;
mod view;

pub use merge::{Merged, one_to_one};
pub use view::{Original, Tilt, tilted_features};

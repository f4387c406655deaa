//! Features of a picture as it looks tilted, for pictures that were taken at a grazing angle to what others show.

mod merge;
#[cfg(test)]
mod tests;
mod view;

pub use merge::{Merged, one_to_one};
pub use view::{Tilt, tilted_features};

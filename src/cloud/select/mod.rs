//! Points of a cloud chosen by what an eye sees of them, by label, by likeness and by pieces.

mod eye;
mod grow;
mod selector;
#[cfg(test)]
mod tests;

pub use eye::Eye;
pub use grow::Likeness;
pub use selector::{SeenRegion, SelectStep, Selection, Selector};

//! Points of a cloud chosen by what an eye sees of them, by label, by likeness and by pieces.

mod eye;
mod grow;
mod pieces;
mod selector;
mod step;
#[cfg(test)]
mod tests;
mod visible;

pub use eye::Eye;
pub use grow::Likeness;
pub use selector::{Selection, Selector};
pub use step::{SeenRegion, SelectStep};

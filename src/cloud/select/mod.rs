//! Selection of points by visibility, by label, by similarity and by connected component.

mod eye;
mod grow;
mod selector;
#[cfg(test)]
mod tests;

pub use eye::Eye;
pub use grow::Likeness;
pub use selector::{SeenRegion, SelectStep, Selection, Selector};

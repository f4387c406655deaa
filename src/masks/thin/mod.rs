//! Thin structures (stems, wires) from a few points along them.
//!
//! A ridge filter finds lines, a minimal path joins one point to the next, and the edges left and
//! right of the path give its width.

mod path;
mod ribbon;
mod ridge;
#[cfg(test)]
mod tests;
mod trace;

pub use trace::trace;

//! Thin structures (stems, wires) from one click or a few points along them.
//!
//! [`follow()`] starts at one click and follows the structure both ways. [`trace()`] needs its ends:
//! a ridge filter finds lines and a minimal path joins one point to the next. The edges left and
//! right of the line give its width.

mod follow;
mod path;
mod ribbon;
mod ridge;
#[cfg(test)]
mod tests;
mod trace;

pub(crate) use follow::follow;
pub use trace::trace;

//! Large sparse symmetric equations in blocks of six unknowns: a pose each.

mod conjugate;
mod kernel;
mod skyline;
mod solve;

#[cfg(test)]
pub use conjugate::conjugate_gradients;
pub use kernel::{BLOCK, Block, Column, dot, subtract_products};
pub use skyline::{Row, Skyline};
pub use solve::solve;

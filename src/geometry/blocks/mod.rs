//! Large sparse symmetric systems of equations in blocks of six unknowns (one pose each).

mod skyline;
mod solve;

pub use skyline::{BLOCK, Block, Column, Row, Skyline, dot, subtract_products};
#[cfg(test)]
pub use solve::conjugate_gradients;
pub use solve::solve;

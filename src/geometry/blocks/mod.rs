//! Large sparse symmetric systems of equations in blocks of six unknowns (one pose each).

mod skyline;
mod solve;

pub use skyline::{BLOCK, Block6, Column6, Skyline, SkylineRow, dot, subtract_products};
#[cfg(test)]
pub use solve::conjugate_gradients;
pub use solve::solve;

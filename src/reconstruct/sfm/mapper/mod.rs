//! Grows sparse models from verified pairs: first pair, resection, triangulation, adjustment.

mod adjust;
mod first_pair;
mod grow;
mod register;
mod state;
#[cfg(test)]
mod tests;
mod triangulate;

pub use first_pair::Start;
pub use grow::{Mapped, map};
pub use register::Refusal;
pub use state::MapperOptions;

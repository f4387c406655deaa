//! Grows sparse models from verified pairs: first pair, resection, triangulation, adjustment.

mod adjust;
mod first_pair;
mod grow;
mod next_image;
mod options;
mod register;
mod run;
mod state;
#[cfg(test)]
mod tests;
mod triangulate;

pub use first_pair::Start;
pub use options::MapperOptions;
pub use register::Refusal;
pub use run::{Mapped, map};

//! Grows sparse models from verified pairs: first pair, resection, triangulation, adjustment.
//!
//! One file per step around one state (`state::Mapper`), which also counts the keypoints of unplaced images
//! that see a point: the next image is the one that they cover best. Knows neither files nor frames.

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

//! Incremental mapping: first pair, resection, triangulation and adjustment of verified pairs.
//!
//! There is one file per step around one state (`state::Mapper`). The state also counts the
//! keypoints of unplaced images that see a point: the next image is the one that these cover best.
//! The mapper does not know files or frames.

mod adjust;
mod effort;
mod extend;
mod first_pair;
mod grow;
mod join;
mod register;
mod state;
#[cfg(test)]
mod tests;
mod triangulate;

pub use extend::extend;
pub use first_pair::{FirstPairRequirement, ModelStart};
pub use grow::{Mapped, map};
pub use join::join_models;
pub use register::Refusal;
pub use state::MapperOptions;

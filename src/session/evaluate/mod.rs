//! Scores of results against truth, without a project: masks, clouds, cameras.
//!
//! May use: scores of masks, scene and geometry. Must not touch: the open project.

mod cameras;
mod cloud;
mod masks;

pub use crate::masks::{MaskScore, ScoreOptions};
pub use crate::scene::score::{CloudScore, cloud_table};
pub use cameras::{CameraScore, score_cameras};
pub use cloud::{CloudEvaluation, evaluate_cloud};
pub use masks::evaluate_masks;

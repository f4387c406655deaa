//! Scores of masks, clouds and cameras against ground truth, and the effort of a simulated user.
//!
//! No project is needed.

mod cameras;
mod cloud;
mod frames;
mod interact;

pub use crate::cloud_score::{CloudScore, cloud_table};
pub use crate::mask_score::{MaskScore, ScoreOptions};
pub use cameras::{CameraScore, score_cameras};
pub use cloud::{CloudEvaluation, TruthViews, evaluate_cloud};
pub use frames::evaluate_masks;
pub use interact::{
    FrameByFrame, Goal, InteractOptions, InteractReport, InteractRequest, Sequence,
    evaluate_interaction, interact,
};

//! Scores of results against truth, without a project: masks, clouds, cameras, and the clicks that a robot user needs.
//!
//! May use: scores of masks, scene and geometry; frames and the features that they have in common (scene::sfm,
//! scene::stereo) for which camera sees what; `interact/` what a session may. Must not touch: the open project.

mod cameras;
mod cloud;
mod frames;
mod interact;
mod masks;
mod seen;

pub use crate::masks::{MaskScore, ScoreOptions};
pub use crate::scene::score::{CloudScore, cloud_table};
pub use cameras::{CameraScore, score_cameras};
pub use cloud::{CloudEvaluation, TruthViews, evaluate_cloud};
pub use interact::{
    FrameByFrame, Goal, InteractOptions, InteractReport, InteractRequest, Sequence, evaluate_interaction, interact,
};
pub use masks::evaluate_masks;

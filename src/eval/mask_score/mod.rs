//! Scores of masks against ground truth masks, as in the DAVIS challenge.

mod boundary;
mod folders;
mod table;

pub use boundary::boundary_f;
pub use folders::{ScoreOptions, score_masks};
pub use table::{FramePair, FrameScore, LabelScore, MaskScore, score_pairs};

//! Scores of masks against true masks, as the DAVIS challenge measures them.

mod boundary;
mod folders;
mod table;

pub use boundary::boundary_f;
pub use folders::{ScoreOptions, score_masks};
pub use table::{FramePair, FrameScore, LabelScore, MaskScore, score_pairs};

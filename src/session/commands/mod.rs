//! What each `Command` does: one file a group, each an `impl Session`.

mod accept;
mod adopt;
mod blend;
mod cameras;
mod choice;
mod correct;
mod export;
mod export_frames;
mod export_inputs;
mod export_scene;
mod found_cameras;
mod fuse;
mod ground;
mod instances;
mod labels;
mod masks;
mod merge_labels;
mod open;
mod paint;
mod prompt;
mod propose;
mod range;
mod reconstruct;
mod relocate;
mod scale;
mod scaled_results;
mod split;
mod stereo;
mod suggest;
mod surface;
mod track;
mod voted_before;

pub use crate::mask_edits::{anchor, mask_of};
pub use crate::track_run::{carried, track_request};
pub use choice::LabelChoice;
pub use prompt::{answer, corrects, with_answer};

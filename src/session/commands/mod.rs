//! What each `Command` does: one file a group, each an `impl Session`.

mod accept;
mod adopt;
mod blend;
mod cameras;
mod choice;
mod correct;
mod depths;
mod export;
mod folders;
mod fuse;
mod ground;
mod instances;
mod labels;
mod masks;
mod merge_labels;
mod models;
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
mod tidy;
mod trace;
mod track;
mod traits;
mod undistorted;
mod undo;
mod voted_before;

pub(super) use accept::by_vote;
pub use choice::LabelChoice;
use folders::make_folder_of;
pub(super) use instances::{FoundInstances, found_instances};
#[cfg(test)]
pub(super) use paint::by_hand;
pub use paint::{anchor, mask_of};
pub use prompt::{answer, corrects, with_answer};
pub use track::{TrackRun, carried, track_request};

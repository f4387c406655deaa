//! What each `Command` does: one file a group, each an `impl Session`.
//!
//! May use: what `session` may. Must not touch: the folder on disk but through `OpenProject`.

mod fuse;
mod labels;
mod open;
mod paint;
mod prompt;
mod reconstruct;
mod relocate;
mod track;
mod undo;

pub(super) use track::TrackRun;

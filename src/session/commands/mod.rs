//! What each `Command` does: one file a group, each an `impl Session`.
//!
//! May use: what `session` may. Must not touch: the folder on disk but through `OpenProject`.

mod labels;
mod open;
mod paint;
mod prompt;
mod relocate;
mod undo;

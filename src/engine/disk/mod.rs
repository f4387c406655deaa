//! Files that are written whole or not at all.
//!
//! May use: std, tempfile. Must not touch: any domain word.

mod atomic;
mod leftovers;

pub use atomic::{AtomicFile, WorkFolder, write};
pub use leftovers::{is_temporary, remove_leftovers};

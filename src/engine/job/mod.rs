//! Work off the window's thread: progress, stopping, named workers, newest-wins slots.
//!
//! May use: std. Must not touch: any domain word.

mod loader;
mod progress;

pub use loader::Loader;
pub use progress::{Progress, ProgressReport, Stopped};

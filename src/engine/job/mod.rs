//! Work off the window's thread: progress, stopping, named workers, newest-wins slots.
//!
//! May use: std. Must not touch: any domain word.

<<<<<<< HEAD
mod loader;
=======
mod latest;
mod pool;
>>>>>>> main
mod progress;
mod running;

<<<<<<< HEAD
pub use loader::Loader;
=======
pub use latest::Latest;
pub use pool::{Full, Pool};
>>>>>>> main
pub use progress::{Progress, ProgressReport, Stopped};
pub use running::{JobError, Running};

//! Background jobs: progress, cancellation, named workers, newest-wins slots.

mod latest;
mod loader;
mod pool;
mod progress;
mod running;

pub use latest::Latest;
pub use loader::Loader;
pub use pool::{Full, Pool};
pub use progress::{Progress, ProgressReport, Stopped};
pub use running::{JobError, JobId, Running};

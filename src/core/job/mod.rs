//! Background jobs: progress, cancellation, named workers, newest-wins slots.

mod latest;
mod loader;
mod pool;
mod progress;
mod running;
mod schedule;
mod time_left;

pub use latest::Latest;
pub use loader::Loader;
pub use pool::{Full, Pool};
pub use progress::{Overview, Progress, ProgressReport, Stopped};
pub use running::{JobError, JobId, Running};
pub use schedule::{PlannedStage, Step, StepState, StepTime};
pub use time_left::time_left_text;

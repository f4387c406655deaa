//! The demo: a synthetic scene, a simulated user in a session, and a report of the accuracy.

mod example;
mod report;
mod run;
mod user;
mod workspace;

pub use example::make_example;
pub use report::{CloudReport, DemoReport, LevelsReport, MaskReport};
pub use run::{DemoMethod, DemoOptions, run_demo};
pub use user::{MAX_CLICKS, ProgressSink};
pub use workspace::finish;

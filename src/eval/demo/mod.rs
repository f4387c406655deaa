//! The demo: a made scene, a simulated user at the session, and a report that holds the result against exact truth.

mod report;
mod run;
mod user;
mod workspace;

pub use report::{CloudReport, DemoReport, LevelsReport, MaskReport};
pub use run::{DemoMethod, DemoOptions, run_demo};
pub use user::{MAX_CLICKS, Watch};
pub use workspace::finish;

//! The demo: a made scene, a simulated user at the session, and a report that holds the result against exact truth.

mod levels;
mod report;
mod run;
mod studio;
mod user;
mod workspace;

pub use report::{CloudReport, DemoReport, LevelsReport, MaskReport};
pub use run::{DemoMethod, DemoOptions, run_demo};
pub use studio::Watch;
pub use user::MAX_CLICKS;
pub use workspace::finish;

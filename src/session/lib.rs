//! Sessions: the open project, its jobs and its background results.
//!
//! A [`Session`] holds at most one open project. Window, command line and recipes all control it
//! with the same [`Command`]s. [`Session::act`] executes quick commands at once and starts a job on
//! a worker thread for the others. [`Session::poll`] applies the results of jobs as edits of the
//! project and returns what happened as [`Event`]s. [`Session::settle`] polls until no job runs, as
//! the command line does. Commands that succeed are collected in a [`Recipe`].
//!
//! Values that are derived from the project are computed in the background when they are first
//! requested. Examples are the cloud, its surface, conflicts and traits. [`Images`] and
//! [`Drawings`] load images for display in the same way. [`commands`] implements the commands, and
//! [`engines`] creates segmenters, trackers and matchers. [`list_engines`] and [`list_models`]
//! report which of them are available.
//!
//! Frames are numbered from 0. Positions in images are in pixels, lengths are in world units, and
//! shares and confidences are between 0 and 1.
//!
//! # Example
//!
//! ```rust
//! use ostra_session::{Command, Session};
//!
//! # fn main() -> anyhow::Result<()> {
//! let mut session = Session::new();
//! assert!(session.project().is_none());
//!
//! // Most commands need an open project.
//! let error = session.act(Command::Undo).unwrap_err();
//! assert!(error.to_string().contains("no project is open"));
//!
//! // Stopping all jobs is always possible, and quick commands start none.
//! assert!(session.act(Command::Stop)?.is_none());
//! assert!(session.poll().is_empty());
//! # Ok(())
//! # }
//! ```

mod act;
mod background;
mod background_jobs;
mod click_segmenter;
mod command;
pub mod commands;
mod drawings;
mod embeddings;
mod engine_table;
pub mod engines;
mod event;
mod grounding;
mod images;
mod job_task;
mod jobs;
mod limits;
mod live_preview;
mod live_revote;
mod models;
mod network_test;
mod networks;
mod poll;
mod prepared;
mod queries;
mod query;
mod recent;
mod recent_projects;
mod recipe;
mod recipe_schema;
mod requests;
mod session;
mod synthetic_images;
#[cfg(test)]
mod tests;
mod track_run;
mod tracker_test;
mod unfinished;

pub use command::{Command, NewProject, Recipe};
pub use drawings::Drawings;
pub use engine_table::{EngineInfo, EngineKind, list_engines};
pub use event::{Event, ExportedItem, JobView};
pub use grounding::{FoundThing, Grounding};
pub use images::Images;
pub use job_task::{JobTask, JobTitle};
pub use jobs::JobKind;
pub use models::{
    add_model, check_model, failed_test_text, install_model, list_addresses, list_models,
    not_run_text, remove_model, test_model,
};
pub use network_test::NetworkTest;
pub use ostra_compute::nn::{
    Added, CheckedFile, Fetched, InstallOptions, Installed, ListedAddress, ModelStatus, Provider,
    TestResult, VariantStatus, Verification,
};
pub use ostra_project::suggestion::{Reason, Suggestion};
pub use ostra_project::{PromptRequest, RangeChange, RangeRequest};
pub use prepared::PreparedFrames;
pub use queries::{
    Angles, DepthPoints, FoundCameras, FoundDepth, MeasureSettings, ProposedInstances,
    SparseReconstruction, SurfaceKind, Survey, SurveyRequest,
};
pub use recent::Recent;
pub use recent_projects::{RecentProject, RecentProjects};
pub use recipe_schema::recipe_schema;
pub use requests::{
    AttachRequest, CleanRequest, CloudChange, CloudCorrection, FindByTextRequest, InstallRequest,
    InstancesRequest, ModelRequest, ModelTask, MoveBorderRequest, PaintRequest, TakeRequest,
    TraceRequest, TrackSettings,
};
pub use session::{JobCompletion, Session};
pub use unfinished::Unfinished;

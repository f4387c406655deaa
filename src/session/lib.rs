//! The open project behind window and command line: [`Command`]s start jobs, jobs end in edits; background results; which
//! engines are loaded.

mod act;
mod background;
mod background_jobs;
mod command;
pub mod commands;
mod drawings;
mod embeddings;
mod engine_table;
pub mod engines;
mod event;
mod grounding;
mod job_task;
mod jobs;
mod limits;
mod live_preview;
mod live_revote;
mod models;
mod networks;
mod pictures;
mod poll;
mod prepared;
mod queries;
mod query;
mod recent;
mod recipe;
mod requests;
mod session;
#[cfg(test)]
mod tests;
mod track_run;

pub use command::{Command, NewProject, Recipe};
pub use drawings::Drawings;
pub use engine_table::{Engine, EngineKind, list_engines};
pub use event::{Event, JobView};
pub use grounding::{FoundThing, Grounding};
pub use job_task::{JobTask, JobTitle};
pub use jobs::JobKind;
pub use models::{add_model, check_model, install_model, list_models};
pub use ostra_compute::nn::{Added, CheckedFile, Fetched, Installed, Proof, Provider, Row};
pub use ostra_project::suggestion::{Reason, Suggestion};
pub use ostra_project::{PromptRequest, RangeChange, RangeRequest};
pub use pictures::Pictures;
pub use prepared::PreparedFrames;
pub use queries::{Angles, MeasureSettings, ProposedInstances, SparseModel, Surface};
pub use recent::Recent;
pub use requests::{
    AdoptRequest, CloudChange, CloudCorrection, GroundRequest, InstancesRequest, ModelRequest,
    ModelTask, PaintRequest, PullRequest, TakeRequest, TidyRequest, TraceRequest, TrackSettings,
};
pub use session::{JobCompletion, Session};

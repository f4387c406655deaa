//! The open project: `Project`, `Edit`, `History`, saving; `Command → Job → Edits`; which engines are loaded.
//!
//! May use: every room above. Must not touch: egui, printing, exit codes.

mod act;
mod apply;
mod around;
mod cloud;
mod command;
mod commands;
pub mod demo;
mod doubt;
mod drawings;
mod edit;
mod engines;
mod estimate;
pub mod evaluate;
mod event;
mod grounding;
mod growing;
mod history;
mod hover;
mod jobs;
mod marks;
mod models;
mod networks;
mod on_demand;
mod open_project;
mod pictures;
mod prepared;
mod project;
mod recent;
#[expect(clippy::module_inception, reason = "the noun lives in a file of its name")]
mod session;
mod sparse;
mod stale;
pub mod store;
mod suggestion;
mod surfaces;
#[cfg(test)]
mod tests;

pub use crate::engine::nn::{Added, CheckedFile, Fetched, Proof, Row};
pub use command::{
    Command, ExportRequest, FuseRequest, GroundRequest, NewProject, PaintRequest, PromptRequest, RangeChange,
    RangeRequest, Recipe, ReconstructMethod, ReconstructRequest, ScaleEnd, ScaleRequest, TakeRequest, TidyRequest,
    TraceRequest, TrackSettings,
};
pub use drawings::Drawings;
pub use edit::Edit;
pub use engines::{Engine, EngineKind, engines};
pub use estimate::Estimate;
pub use event::{Event, JobId, JobView};
pub use grounding::{FoundThing, Grounding};
pub use history::{Change, History, Step};
pub use marks::Marks;
pub use models::{add_model, check_model, install_model, list_models};
pub use open_project::OpenProject;
pub use pictures::Pictures;
pub use project::{FrameMask, MaskOrigin, Project, ResultKind, ResultRecord};
pub use recent::Recent;
pub use session::Session;
pub use sparse::SparseModel;
pub use suggestion::Suggestion;
pub use surfaces::Surface;

//! The open project: `Project`, `Edit`, `History`, saving; `Command → Job → Edits`; which engines are loaded.
//!
//! May use: every room above. Must not touch: egui, printing, exit codes.

mod act;
mod adopt_request;
mod angles;
mod apply;
mod around;
mod cloud;
mod command;
mod commands;
mod contradicted;
mod coordinates;
mod correction;
pub mod demo;
mod doubt;
mod drawings;
mod edit;
mod embeddings;
mod engines;
mod estimate;
pub mod evaluate;
mod event;
mod export_claim;
mod export_record;
pub mod export_targets;
mod following;
mod grounding;
mod growing;
mod history;
mod hover;
mod instances_request;
mod jobs;
mod limits;
mod marks;
mod mask_requests;
mod measuring;
mod models;
mod networks;
mod on_demand;
mod open_project;
mod origin;
mod pictures;
mod portrayal;
mod prepared;
mod project;
mod proposed;
mod recent;
mod recipe;
mod scene_requests;
mod selected;
#[expect(clippy::module_inception, reason = "the noun lives in a file of its name")]
mod session;
mod sparse;
mod stale;
pub mod store;
mod suggestion;
mod surfaces;
#[cfg(test)]
mod tests;

pub use crate::engine::nn::{Added, CheckedFile, Fetched, Installed, Proof, Provider, Row};
pub use adopt_request::AdoptRequest;
pub use angles::Angles;
pub use command::{Command, NewProject, Recipe, TrackSettings};
pub use coordinates::{Coordinates, scale_between};
pub use correction::{CloudChange, CloudCorrection};
pub use drawings::Drawings;
pub use edit::Edit;
pub use engines::{Engine, EngineKind, engines};
pub use estimate::Estimate;
pub use event::{Event, JobId, JobView};
pub use grounding::{FoundThing, Grounding};
pub use history::{Change, History, Step};
pub use instances_request::InstancesRequest;
pub use marks::Marks;
pub use mask_requests::{
    GroundRequest, PaintRequest, PromptRequest, PullRequest, RangeChange, RangeRequest, TakeRequest, TidyRequest,
    TraceRequest,
};
pub use measuring::MeasureWish;
pub use models::{ModelRequest, ModelTask, add_model, check_model, install_model, list_models};
pub use open_project::OpenProject;
pub use pictures::Pictures;
pub use project::{FrameMask, MaskOrigin, Project, ResultKind, ResultRecord};
pub use proposed::ProposedInstances;
pub use recent::Recent;
pub use scene_requests::{ExportRequest, FuseRequest, ReconstructMethod, ReconstructRequest, ScaleEnd, ScaleRequest};
pub use session::Session;
pub use sparse::SparseModel;
pub use suggestion::{Reason, Suggestion};
pub use surfaces::Surface;

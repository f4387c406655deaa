//! The open project behind window and command line: [`Command`]s start jobs, jobs end in edits; background results; which
//! engines are loaded.

mod act;
mod adopt_request;
mod angles;
mod around;
mod cloud;
mod command;
pub mod commands;
mod contradicted;
mod correction;
mod doubt;
mod drawings;
mod embeddings;
pub mod engines;
mod event;
mod following;
mod grounding;
mod growing;
mod hover;
mod instances_request;
mod jobs;
mod limits;
mod mask_requests;
mod measuring;
mod models;
mod networks;
mod on_demand;
mod pictures;
mod portrayal;
mod prepared;
mod proposed;
mod recent;
mod recipe;
mod selected;
mod session;
mod sparse;
mod surfaces;
#[cfg(test)]
mod tests;

pub use adopt_request::AdoptRequest;
pub use angles::Angles;
pub use command::{Command, NewProject, Recipe, TrackSettings};
pub use correction::{CloudChange, CloudCorrection};
pub use drawings::Drawings;
pub use engines::{Engine, EngineKind, list_engines};
pub use event::{Event, JobView};
pub use grounding::{FoundThing, Grounding};
pub use instances_request::InstancesRequest;
pub use jobs::{Kind, Landing};
pub use mask_requests::{
    GroundRequest, PaintRequest, PullRequest, TakeRequest, TidyRequest, TraceRequest,
};
pub use measuring::MeasureWish;
pub use models::{ModelRequest, ModelTask, add_model, check_model, install_model, list_models};
pub use ostra_compute::nn::{Added, CheckedFile, Fetched, Installed, Proof, Provider, Row};
pub use ostra_project::suggestion::{Reason, Suggestion};
pub use ostra_project::{PromptRequest, RangeChange, RangeRequest};
pub use pictures::Pictures;
pub use prepared::PreparedFrames;
pub use proposed::ProposedInstances;
pub use recent::Recent;
pub use session::Session;
pub use sparse::SparseModel;
pub use surfaces::Surface;

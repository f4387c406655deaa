//! The project: its data, edits and history, and the store on disk.

mod apply;
mod coordinates;
mod edit;
mod engine_ids;
pub mod export_record;
pub mod export_targets;
mod history;
mod interpolate;
mod label_choice;
pub mod label_edits;
mod marks;
pub mod mask_edits;
mod open_project;
mod origin;
mod project;
pub mod prompt;
pub mod range;
mod requests;
mod results;
pub mod reusable_votes;
mod split;
mod stale;
pub mod store;
pub mod suggestion;
#[cfg(any(test, feature = "testing"))]
pub mod testing;
pub mod voted_cloud;

pub use coordinates::scale_between;
pub use edit::Edit;
pub use engine_ids::{
    DeviceId, EngineName, FeatureId, GrounderId, MatcherId, RegistrationId, SegmenterId, TrackerId,
    UnknownEngine,
};
pub use history::{Change, History, Step};
pub use label_choice::LabelChoice;
pub use open_project::OpenProject;
pub use origin::{make_relative, origin_near};
pub use project::{Estimate, FrameMask, Marks, MaskOrigin, Project};
pub use requests::{
    ExportRequest, FuseRequest, PromptRequest, RangeChange, RangeRequest, ReconstructMethod,
    ReconstructRequest, ScaleEnd, ScaleRequest,
};
pub use results::{Coordinates, ResultEngine, ResultKind, ResultRecord};

//! The project: its data, edits and history, and the store on disk.

mod anchors;
mod apply;
mod coordinates;
mod edit;
mod estimate;
pub mod export_claim;
pub mod export_record;
pub mod export_targets;
mod history;
mod marks;
mod open_project;
mod origin;
mod project;
mod scene_requests;
mod stale;
pub mod store;
#[cfg(any(test, feature = "testing"))]
pub mod testing;

pub use coordinates::{Coordinates, scale_between};
pub use edit::Edit;
pub use estimate::Estimate;
pub use history::{Change, History, Step};
pub use marks::Marks;
pub use open_project::OpenProject;
pub use origin::{make_relative, origin_near};
pub use project::{FrameMask, MaskOrigin, Project, ResultKind, ResultRecord};
pub use scene_requests::{
    ExportRequest, FuseRequest, ReconstructMethod, ReconstructRequest, ScaleEnd, ScaleRequest,
};

//! The project: its data, edits and history, and the store on disk.

mod apply;
mod coordinates;
mod edit;
pub mod export_record;
pub mod export_targets;
mod history;
mod marks;
mod open_project;
mod origin;
mod project;
mod results;
mod scene_requests;
mod stale;
pub mod store;
#[cfg(any(test, feature = "testing"))]
pub mod testing;

pub use coordinates::scale_between;
pub use edit::Edit;
pub use history::{Change, History, Step};
pub use open_project::OpenProject;
pub use origin::{make_relative, origin_near};
pub use project::{Estimate, FrameMask, Marks, MaskOrigin, Project};
pub use results::{Coordinates, ResultKind, ResultRecord};
pub use scene_requests::{
    ExportRequest, FuseRequest, ReconstructMethod, ReconstructRequest, ScaleEnd, ScaleRequest,
};

//! The open project: `Project`, `Edit`, `History`, saving; `Command → Job → Edits`; which engines are loaded.
//!
//! May use: every room above. Must not touch: egui, printing, exit codes.

mod apply;
mod command;
mod edit;
mod history;
mod open_project;
mod pictures;
mod project;
mod stale;
pub mod store;

pub use command::{
    Command, ExportRequest, FuseRequest, NewProject, PaintRequest, PromptRequest, Recipe, ReconstructMethod,
    ReconstructRequest, TrackSettings,
};
pub use edit::Edit;
pub use history::{Change, History, Step};
pub use open_project::OpenProject;
pub use pictures::Pictures;
pub use project::{FrameMask, MaskOrigin, Project, ResultKind, ResultRecord};

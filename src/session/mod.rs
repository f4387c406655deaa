//! The open project: `Project`, `Edit`, `History`, saving; `Command → Job → Edits`; which engines are loaded.
//!
//! May use: every room above. Must not touch: egui, printing, exit codes.

mod command;
mod edit;
mod pictures;
mod project;

pub use command::{
    Command, ExportRequest, FuseRequest, NewProject, PaintRequest, PromptRequest, Recipe, ReconstructMethod,
    ReconstructRequest, TrackSettings,
};
pub use edit::Edit;
pub use pictures::Pictures;
pub use project::{FrameMask, MaskOrigin, Project, ResultKind, ResultRecord};

//! Dialogs: one file each; at most one is open.

mod export;
mod into;
mod new_project;
mod palette;
mod path;
mod picker;
mod sheet;
mod sources;

pub use export::ExportForm;
pub use new_project::NewProjectForm;
pub use picker::PathPicker;
pub use sheet::SheetState;

pub(super) use export::export_ui;
pub(super) use into::into_ui;
pub(super) use new_project::new_project_ui;
pub(super) use palette::palette_ui;
pub(super) use path::path_ui;
pub(super) use picker::take_picked;
pub(super) use sheet::sheet_ui;

//! Dialogs: one file each; at most one is open.

mod export;
mod into;
mod mask_format;
mod models;
mod new_project;
mod palette;
mod path;
mod picker;
mod picture;
mod relocate;
mod sheet;
mod sources;

pub use export::ExportForm;
pub use models::ModelsForm;
pub use new_project::NewProjectForm;
pub use picker::PathPicker;
pub use picture::{PictureForm, PictureWish, Take};
pub use relocate::RelocateForm;
pub use sheet::SheetState;

pub(super) use export::export_ui;
pub(super) use into::into_ui;
pub(super) use models::models_ui;
pub(super) use new_project::new_project_ui;
pub(super) use palette::palette_ui;
pub(super) use path::path_ui;
pub(super) use picker::{Pick, PickTarget, path_field_ui, take_picked};
pub(super) use picture::picture_ui;
pub(super) use relocate::relocate_ui;
pub(super) use sheet::sheet_ui;

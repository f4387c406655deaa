//! Dialogs of the window, at most one of which is open.

mod export;
mod export_form;
mod export_presets;
mod exported;
mod forms;
mod go_to_frame;
mod help;
mod help_page;
mod into;
mod models;
mod new_project;
mod new_project_form;
mod palette;
mod path;
mod picker;
mod preferences;
mod scene_image;
mod sheet;
mod survey;

pub(super) use export::export_ui;
pub use export_form::ExportForm;
pub(super) use exported::exported_ui;
pub use forms::{
    ImageForm, Installation, IntoRequest, ModelsForm, PaletteState, RecipeTarget, RelocateForm,
    ScreenshotRequest, SheetState, Take,
};
pub(super) use go_to_frame::go_to_frame_ui;
pub(super) use help::help_ui;
pub use help_page::HelpPage;
pub(super) use into::into_ui;
pub(super) use models::models_ui;
pub(super) use new_project::new_project_ui;
pub use new_project_form::{NewProjectForm, SourceKind};
pub(super) use palette::palette_ui;
pub(super) use path::{choose_path, path_ui, relocate_ui, take_picked};
pub(super) use picker::{FileKind, PathField, Pick, PickTarget, path_field_ui, typed_path};
pub use picker::{PathPicker, PathRequest};
pub(super) use preferences::preferences_ui;
pub(super) use scene_image::image_ui;

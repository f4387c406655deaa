//! The picture with its mask: zoom and pan, prompts, brush, polygon and lasso, borders that are pulled, thin
//! structures.

mod draft;
mod input;
mod map;
mod paint;
mod picture_pane;
mod prompts;
mod toolbar;

pub use draft::{Draft, Tool};
pub use map::{CanvasMap, ZoomState};
pub(super) use picture_pane::picture_pane_ui;
pub(super) use prompts::{clear_label, click_at, id_at};

//! Image pane: zoom and pan, mask overlay, and the tools for prompts and painting.

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

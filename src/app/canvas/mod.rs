//! Image pane: zoom and pan, mask overlay, and the tools for prompts and painting.

mod answer_bar;
mod answer_state;
mod draft;
mod image_pane;
mod input;
mod key_pointer;
mod map;
mod paint;
mod preview;
mod prompts;
mod shown_image;
mod toolbar;

pub use answer_state::AnswerBar;
pub use draft::{Draft, Tool};
pub(super) use image_pane::image_pane_ui;
pub use key_pointer::KeyPointer;
pub use map::{CanvasMap, ZoomState};
pub use preview::PreviewOutline;
pub(super) use prompts::{clear_label, click_at, id_at, label_extent, step_size};

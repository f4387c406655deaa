//! Labels, prompts and one mask per frame; the seams `Segmenter`, `TextGrounder`, `Tracker`; mask formats.
//!
//! May use: frames, engine::job. Only `onnx/` uses engine::nn. Must not touch: cameras, 3-D, UI.

pub mod builtin;
mod error;
mod label;
mod mask;
mod prompt;
mod robot;
mod seam;

pub use error::MaskError;
pub use label::{Label, LabelId, LabelTree};
pub use mask::{LabelMask, Region, RunMask};
pub use prompt::{Click, Prompt, PxBox};
pub use robot::next_click;
pub use seam::{Direction, PreparedFrame, SegmentRequest, Segmenter, TrackRequest, TrackedFrame, Tracker};

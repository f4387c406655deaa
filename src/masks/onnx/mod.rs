//! Networks behind the seams of masks: Segment Anything, YOLOX, Grounding DINO.
//!
//! May use: engine::nn, engine::job, frames, the nouns of masks. Must not touch: cameras, 3-D, UI.

mod boxes;
mod coco;
pub mod grounding;
mod resize;
pub mod sam;
mod yolox;

pub use yolox::Yolox;

//! Segmenters that run networks: Segment Anything.
//!
//! May use: engine::nn, engine::job, frames, the nouns of masks. Must not touch: cameras, 3-D, UI.

mod resize;
pub mod sam;

//! Networks behind the seams of masks: Segment Anything, Grounding DINO, XMem, DeAOT, YOLOX; XFeat as what the flow tracker
//! remembers by.
//!
//! May use: engine::nn, engine::job, frames, the nouns of masks. Must not touch: cameras, 3-D, UI.

mod boxes;
mod coco;
pub mod deaot;
pub mod grounding;
mod propagate;
mod resize;
pub mod sam;
mod xfeat;
pub mod xmem;
mod yolox;

pub use xfeat::XFeatCells;
pub use yolox::Yolox;

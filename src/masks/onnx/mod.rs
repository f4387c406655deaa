//! Networks behind the seams of masks: Segment Anything, Grounding DINO, XMem, DeAOT, YOLOX; XFeat as what the flow
//! tracker remembers by.

mod boxes;
mod coco;
pub mod grounding;
mod resize;
pub mod sam;
mod yolox;

pub use resize::resized_planes;
pub use yolox::Yolox;

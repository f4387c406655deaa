//! Segmentation and detection by neural networks: Segment Anything, Grounding DINO, YOLOX.

mod coco_classes;
pub mod grounding;
mod non_maximum_suppression;
mod resize;
pub mod sam;
mod yolox;

pub use resize::resized_planes;
pub use yolox::Yolox;

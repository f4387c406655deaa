//! Manual editing of masks.
//!
//! This module contains the brush, the eraser, polygons and border dragging. It also writes a
//! segmenter's answer into a frame's mask.

mod assign;
mod brush;
mod interpolate;
mod polygon;
mod pull;
mod snap;
mod split;
mod tidy;
mod transfer;

pub use assign::{LabelAnswer, PaintRule, assign, compose, erase, taken_by_others};
pub use brush::stroke;
pub use interpolate::ShapeBlend;
pub use polygon::{fill_polygons, polygon_spans};
pub use pull::{BorderDrag, ElasticBorders, Pull, pull};
pub use snap::snapped_stroke;
pub use split::nearer_part;
pub use tidy::tidy;
pub use transfer::{hold, transfer};

#[cfg(test)]
mod tests;

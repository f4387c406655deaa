//! Labels, prompts and one mask per frame; editing masks; the traits [`Segmenter`], [`TextGrounder`], [`Tracker`]; mask
//! formats; the built-in segmenter and those made of networks.

mod components;
pub mod cut;
mod distance;
mod edit;
mod engines;
mod error;
mod formats;
mod frontier;
pub mod graph_cut;
pub mod lab;
mod label_tree;
mod mask;
mod maxflow;
mod merge;
pub mod onnx;
mod outline;
mod prompt;
mod region;
mod run_mask;
mod thin;
pub mod unexplained;

pub use components::{Components, Connectivity, components};
pub use distance::{deepest_point, landmarks, squared_depth_in, squared_distance_to};
pub use edit::{
    ElasticBorders, LabelAnswer, PaintRule, Pull, ShapeBlend, assign, compose, erase,
    fill_polygons, hold, nearer_part, polygon_spans, pull, snapped_stroke, stroke, taken_by_others,
    tidy, transfer,
};
pub use engines::{
    Direction, GroundRequest, Grounded, PreparedFrame, Proposal, SegmentRequest, Segmenter,
    TextGrounder, TrackRequest, TrackedFrame, Tracker,
};
pub use error::MaskError;
pub use formats::{
    Imported, MaskFolder, MaskFormat, MaskFrame, MatchedMask, MatchedMasks, encode_palette_png,
    export_masks, file_stems, import_masks, read_labels_json, read_palette_png,
    read_palette_png_of, write_labels_json,
};
pub use lab::{lab_of_pixel, squared_difference};
pub use label_tree::{Label, LabelId, LabelTree, MAX_DEPTH};
pub use mask::LabelMask;
pub use merge::{WalkedFrame, merged};
pub use outline::{Outline, outlines, simplified_ring};
pub use prompt::{Click, Prompt, PxBox};
pub use region::Region;
pub use run_mask::{Extent, RunMask};
pub use thin::trace;
pub use unexplained::{Apartness, Unexplained};

//! Labels and masks of frames: their types, editing, segmentation and file formats.
//!
//! A [`LabelTree`] names what pixels can be: an object, its instances and their parts. A
//! [`LabelMask`] holds one [`LabelId`] per pixel of a frame, where 0 is unlabelled. [`RunMask`] is
//! the same mask in run-length form, as projects store it. A [`Region`] holds the pixels of a
//! single object.
//!
//! Masks are made and changed in these ways:
//!
//! - [`Segmenter`] turns a [`Prompt`] of clicks and boxes into a region, and [`compose`] writes it
//!   into a mask. [`graph_cut`] has one that needs no network; [`onnx`] runs Segment Anything.
//! - [`TextGrounder`] finds boxes of objects that a text names. [`onnx`] runs Grounding DINO and
//!   YOLOX.
//! - [`Tracker`] propagates masks from keyframes to other frames. Trackers are implemented in
//!   `ostra-tracking`.
//! - [`stroke`], [`fill_polygons`], [`pull`], [`tidy`] and [`ShapeBlend`] are manual edits.
//!   [`PaintRule`] decides whether other labels are painted over.
//! - [`unexplained`] finds areas without a label that may be new objects.
//! - [`MaskFormat`] reads and writes masks in files of other programs.
//!
//! Positions are in pixels of the image as displayed. The origin is the top-left corner of the
//! image, so the centre of the top-left pixel is at (0.5, 0.5). Pixel data is stored row by row.
//! Colours are sRGB, and colour differences are computed in CIE Lab ([`lab`]).
//!
//! # Example
//!
//! A label and its part are painted into a mask. The part takes pixels from the label above it.
//!
//! ```rust
//! use glam::DVec2;
//! use ostra_masks::{Label, LabelId, LabelMask, LabelTree, PaintRule, RunMask, assign, stroke};
//!
//! # fn main() -> Result<(), ostra_masks::MaskError> {
//! let label = |id: u16, name: &str, parent: Option<LabelId>| Label {
//!     id: LabelId(id),
//!     name: name.to_owned(),
//!     color: LabelTree::color_for(LabelId(id)),
//!     parent,
//! };
//! let (rice, grain) = (LabelId(1), LabelId(2));
//! let tree = LabelTree::try_from(vec![label(1, "rice", None), label(2, "grain", Some(rice))])?;
//!
//! let mut mask = LabelMask::empty(64, 48);
//! let line = [DVec2::new(10.0, 24.0), DVec2::new(54.0, 24.0)];
//! let leaf = stroke(mask.width, mask.height, &line, 6.0)?;
//! assign(&mut mask, &leaf, rice, PaintRule::Protect, &tree)?;
//!
//! let dot = stroke(mask.width, mask.height, &line[1..], 4.0)?;
//! let changed = assign(&mut mask, &dot, grain, PaintRule::Protect, &tree)?;
//! assert_eq!(changed, dot.area());
//! assert_eq!(mask.at(54, 24), grain);
//! assert_eq!(mask.region_with_parts(rice, &tree), leaf);
//!
//! assert_eq!(RunMask::encode(&mask).decode(), mask);
//! # Ok(())
//! # }
//! ```

mod answer_size;
mod click_disc;
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

pub use answer_size::AnswerSize;
pub use click_disc::obey;
pub use components::{Components, Connectivity, components};
pub use distance::{deepest_point, landmarks, squared_depth_in, squared_distance_to};
pub use edit::{
    BorderDrag, ElasticBorders, LabelAnswer, PaintRule, Pull, ShapeBlend, assign, compose, erase,
    fill_polygons, hold, nearer_part, polygon_spans, pull, snapped_stroke, stroke, taken_by_others,
    tidy, transfer,
};
pub use engines::{
    AnswerSource, Direction, GroundRequest, Grounded, PreparedFrame, Proposal, SegmentRequest,
    Segmenter, TextGrounder, TrackRequest, TrackedFrame, Tracker,
};
pub use error::MaskError;
pub use formats::{
    Imported, MaskFolder, MaskFormat, MaskFrame, MatchedMask, MatchedMasks, encode_palette_png,
    file_stems, read_labels_json, read_palette_png, read_palette_png_of, write_labels_json,
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

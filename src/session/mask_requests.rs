use glam::DVec2;
use serde::{Deserialize, Serialize};

use ostra_masks::{LabelId, PxBox};

/// What to look for by words.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GroundRequest {
    /// Frame number.
    pub frame: usize,
    /// Each of them names a class of things.
    pub phrases: Vec<String>,
    /// Least score of what is found, 0–1; chosen by the grounder when absent.
    #[serde(default)]
    pub threshold: Option<f32>,
    /// Which grounder; `auto` = the best that is installed.
    #[serde(default = "auto")]
    pub grounder: String,
}

/// Things that become labels, each an instance of its phrase's.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TakeRequest {
    /// Frame number.
    pub frame: usize,
    /// What each is, and the box around it.
    pub things: Vec<(String, PxBox)>,
    /// Which segmenter makes masks of the boxes; `auto` = the best that is installed.
    #[serde(default = "auto")]
    pub segmenter: String,
}

/// A stroke on a frame's mask.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PaintRequest {
    /// Frame number.
    pub frame: usize,
    /// The label painted, or the one erased.
    pub label: LabelId,
    /// Corners of the stroke or polygon in pixels.
    pub points_px: Vec<DVec2>,
    /// Brush radius in pixels; 0 = the points are a polygon to fill.
    pub radius_px: f64,
    /// `true` takes the label away where the stroke goes.
    pub erase: bool,
    /// `true` = pixels of other labels are taken over too.
    pub replace: bool,
    /// `true` = the brush stops at the picture's edges on which the inner half of its radius does not lie; a polygon
    /// is filled as it is.
    #[serde(default)]
    pub snap: bool,
}

/// A border of a label pulled to where it belongs, on a frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PullRequest {
    /// Frame number.
    pub frame: usize,
    /// The label whose border is pulled.
    pub label: LabelId,
    /// Pulled from the place on its borders that is nearest to this, in pixels.
    pub from_px: DVec2,
    /// Where it is pulled to, in pixels.
    pub to_px: DVec2,
    /// `true` = pixels of other labels are taken over too.
    pub replace: bool,
}

/// A thin structure (stem, wire) on a frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TraceRequest {
    /// Frame number.
    pub frame: usize,
    /// The label that gets its pixels.
    pub label: LabelId,
    /// Two points along it or more, in pixels; it ends at the first and the last.
    pub points_px: Vec<DVec2>,
    /// `true` = pixels of other labels are taken over too.
    #[serde(default)]
    pub replace: bool,
}

/// Holes and islands of a label on a frame.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct TidyRequest {
    /// Frame number.
    pub frame: usize,
    /// The label; pixels of others stay.
    pub label: LabelId,
    /// Holes of fewer pixels are filled; 0 = none.
    #[serde(default)]
    pub holes_below_px: usize,
    /// Islands of fewer pixels are removed, never the largest piece; 0 = none.
    #[serde(default)]
    pub islands_below_px: usize,
}

fn auto() -> String {
    "auto".into()
}

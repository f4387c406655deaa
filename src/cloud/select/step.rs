use glam::{DVec2, Mat4};
use serde::{Deserialize, Serialize};

use super::{Eye, Likeness};
use ostra_masks::LabelId;

/// One act of choosing points; a list of them is a selection that can be written down and made again.
#[expect(
    clippy::large_enum_variant,
    reason = "a selection holds a handful of steps"
)]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SelectStep {
    /// Adds the points that are seen in a region of a picture, or takes them out.
    Seen(SeenRegion),
    /// Adds all points of a label.
    Label(LabelId),
    /// Keeps only the points of a label.
    Only(LabelId),
    /// Adds the points around that are alike.
    Grow(Likeness),
    /// Keeps only the n-th largest piece, counted from 0: points that hang together.
    Piece(usize),
}

/// A lasso, a box or a brush stroke over what an eye sees.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SeenRegion {
    /// Who sees.
    pub eye: Eye,
    /// Corners of the lasso or points of the stroke, in pixels of the eye's picture.
    pub points_px: Vec<DVec2>,
    /// Radius of the brush in pixels; 0 = the points are the corners of a lasso.
    #[serde(default)]
    pub radius_px: f64,
    /// The points are taken out of the selection.
    #[serde(default)]
    pub remove: bool,
    /// Labels (each with all below it) that are looked through.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub hidden: Vec<LabelId>,
    /// The label beside which (and all below it) everything is looked through; `None` = nothing stands out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub isolated: Option<LabelId>,
    /// All but points whose label won less than this share of the votes are looked through, 0–1; `None` = nothing stands out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub doubtful_below: Option<f32>,
    /// What takes the part of world space that is there to be seen to the cube from −1 to 1; `None` = all of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cube_from_world: Option<Mat4>,
}

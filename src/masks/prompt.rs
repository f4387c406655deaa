use glam::DVec2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::AnswerSize;

/// A click: its pixel belongs to the object, or does not.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Click {
    /// Position in pixels of the image as shown (centre of the top-left pixel at 0.5, 0.5).
    #[schemars(with = "[f64; 2]")]
    pub at_px: DVec2,
    /// `true` = include, `false` = exclude.
    pub include: bool,
}

impl Click {
    /// Returns the index, row by row, of the clicked pixel; `None` outside the frame.
    #[must_use]
    pub fn pixel_in(&self, width: u32, height: u32) -> Option<usize> {
        let (x, y) = (self.at_px.x.floor(), self.at_px.y.floor());
        let inside = x >= 0.0 && y >= 0.0 && x < f64::from(width) && y < f64::from(height);
        inside.then(|| y as usize * width as usize + x as usize)
    }
}

/// An axis-aligned box around an object, in pixels of the image as shown.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PxBox {
    /// Top-left corner.
    #[schemars(with = "[f64; 2]")]
    pub min_px: DVec2,
    /// Bottom-right corner.
    #[schemars(with = "[f64; 2]")]
    pub max_px: DVec2,
}

impl PxBox {
    /// Returns the intersection over union of the areas of two boxes; 0 if one is empty.
    #[must_use]
    pub fn iou(&self, other: &Self) -> f64 {
        let area = |min: DVec2, max: DVec2| (max - min).max(DVec2::ZERO).element_product();
        let both = area(self.min_px.max(other.min_px), self.max_px.min(other.max_px));
        let either = area(self.min_px, self.max_px) + area(other.min_px, other.max_px) - both;
        if either > 0.0 { both / either } else { 0.0 }
    }
}

/// Clicks and boxes that the user gave for one label on one frame.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct Prompt {
    /// Clicks, in the order they were given.
    #[serde(default)]
    pub clicks: Vec<Click>,
    /// Boxes, each of which contains (a part of) the object.
    #[serde(default)]
    pub boxes: Vec<PxBox>,
    /// Whether the clicks correct a mask that was not built from clicks but tracked, drawn or read.
    ///
    /// Each click then corrects only the error that it lies in; the rest of the mask stays.
    #[serde(default)]
    pub corrects: bool,
    /// Size of the answer to the last click.
    #[serde(default)]
    pub size: AnswerSize,
}

impl Prompt {
    /// Returns whether two prompts have the same clicks and boxes.
    #[must_use]
    pub fn has_inputs_of(&self, other: &Self) -> bool {
        self.clicks == other.clicks && self.boxes == other.boxes
    }

    /// Returns whether two prompts have the same clicks, boxes and size.
    #[must_use]
    pub fn gives_as(&self, other: &Self) -> bool {
        self.has_inputs_of(other) && self.size == other.size
    }

    /// Returns whether a click or a box says where the object is.
    #[must_use]
    pub fn has_inside(&self) -> bool {
        !self.boxes.is_empty() || self.clicks.iter().any(|click| click.include)
    }

    /// Returns whether there are no clicks and no boxes.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.clicks.is_empty() && self.boxes.is_empty()
    }
}

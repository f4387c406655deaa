use glam::DVec2;
use serde::{Deserialize, Serialize};

/// A click: this pixel belongs to the object, or does not.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Click {
    /// Position in pixels of the picture as shown (centre of the top-left pixel at 0.5, 0.5).
    pub at_px: DVec2,
    /// `true` = include, `false` = exclude.
    pub include: bool,
}

/// An axis-parallel box around an object, in pixels of the picture as shown.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PxBox {
    /// Top-left corner.
    pub min_px: DVec2,
    /// Bottom-right corner.
    pub max_px: DVec2,
}

/// All that the user gave for one label on one frame.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Prompt {
    /// In the order they were given.
    #[serde(default)]
    pub clicks: Vec<Click>,
    /// Each box holds (a part of) the object.
    #[serde(default)]
    pub boxes: Vec<PxBox>,
}

impl Prompt {
    /// Whether nothing was given.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.clicks.is_empty() && self.boxes.is_empty()
    }
}

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

impl Click {
    /// Place of the pixel it falls on in a frame's pixels row by row; `None` outside the frame.
    #[must_use]
    pub fn pixel_in(&self, width: u32, height: u32) -> Option<usize> {
        let (x, y) = (self.at_px.x.floor(), self.at_px.y.floor());
        let inside = x >= 0.0 && y >= 0.0 && x < f64::from(width) && y < f64::from(height);
        inside.then(|| y as usize * width as usize + x as usize)
    }
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

use serde::{Deserialize, Serialize};

use crate::stereo::filter::Agreement;

/// How depth maps become points.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct FusionOptions {
    /// When pixels of two views see the same point.
    pub agreement: Agreement,
    /// Pixels that a point needs, each of another view and its own among them, at least 1; as many as there are views
    /// where these are fewer.
    pub min_pixels: usize,
}

impl Default for FusionOptions {
    fn default() -> Self {
        Self {
            agreement: Agreement::default(),
            min_pixels: 3,
        }
    }
}

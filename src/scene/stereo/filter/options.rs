use serde::{Deserialize, Serialize};

use super::consistency::Agreement;

/// Which depths are kept.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct FilterOptions {
    /// Largest difference of two views' depths as a share of the depth, 0–1.
    pub depth_tolerance: f32,
    /// Largest distance after going to another view and back, pixels of the raster, above 0.
    pub reprojection_px: f32,
    /// Largest angle between two views' normals, 0–180 degrees.
    pub normal_deg: f32,
    /// Other views that must agree, at least 1; all there are where these are fewer.
    pub min_agreeing: usize,
    /// Least confidence, 0–1.
    pub min_confidence: f32,
    /// Connected surfaces are left out whose pixels other views agree with fewer times in all.
    pub min_support: usize,
    /// Gaps of up to this many pixels between two of one surface are filled.
    pub gap_pixels: usize,
    /// Neighbouring pixels are one surface where their depths differ by at most this share, 0–1.
    pub surface_tolerance: f32,
}

impl Default for FilterOptions {
    fn default() -> Self {
        Self {
            depth_tolerance: 0.01,
            reprojection_px: 2.0,
            normal_deg: 60.0,
            min_agreeing: 2,
            min_confidence: 0.2,
            min_support: 60,
            gap_pixels: 7,
            surface_tolerance: 0.01,
        }
    }
}

impl FilterOptions {
    /// When two views see the same.
    #[must_use]
    pub fn agreement(&self) -> Agreement {
        Agreement {
            depth: self.depth_tolerance,
            reprojection_px: self.reprojection_px,
            normal_cosine: self.normal_deg.to_radians().cos(),
        }
    }
}

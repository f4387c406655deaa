use serde::{Deserialize, Serialize};

/// When two views' depths are the same surface.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Agreement {
    /// Largest difference of depth as a share of it, 0–1.
    pub depth: f32,
    /// Largest distance after going there and back, pixels of the raster, above 0.
    pub reprojection_px: f32,
    /// Least cosine between the normals, −1–1: those of parts a pixel or two wide are hardly known.
    pub normal_cosine: f32,
}

impl Default for Agreement {
    fn default() -> Self {
        Self {
            depth: 0.01,
            reprojection_px: 2.0,
            normal_cosine: 0.09,
        }
    }
}

/// When borders of surfaces move to where colours change.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SnapOptions {
    /// Depths that differ by more than this share are two surfaces, above 0.
    pub surface_step: f32,
    /// Difference of colour (in grey levels) of `exp(−½)` in how well pixels fit, above 0.
    pub color_sigma: f32,
    /// Pixels of the other surface that must fit at least, each counted by how well it does.
    pub least_fit: f32,
    /// How many times better its colours must fit, above 1.
    pub better: f32,
}

impl Default for SnapOptions {
    fn default() -> Self {
        Self {
            surface_step: 0.05,
            color_sigma: 20.0,
            least_fit: 1.0,
            better: 2.0,
        }
    }
}

/// When a view takes over what others see.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct CompleteOptions {
    /// Nearer than a view's own depth by this share is before it, 0–1.
    pub before: f32,
    /// Largest difference of colour between the view and what is taken over, grey levels.
    pub color_difference: f32,
    /// The difference of colour may be this many times that of the view's own depth, where it has one, above 0.
    pub color_ratio: f32,
}

impl Default for CompleteOptions {
    fn default() -> Self {
        Self {
            before: 0.02,
            color_difference: 40.0,
            color_ratio: 1.0,
        }
    }
}

/// Which depths are kept.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct FilterOptions {
    /// What happens at borders first.
    pub snap: SnapOptions,
    /// When another view agrees.
    pub agreement: Agreement,
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
    /// What is taken over from others in the end.
    pub complete: CompleteOptions,
}

impl Default for FilterOptions {
    fn default() -> Self {
        Self {
            snap: SnapOptions::default(),
            agreement: Agreement::default(),
            min_agreeing: 2,
            min_confidence: 0.1,
            min_support: 20,
            gap_pixels: 7,
            surface_tolerance: 0.01,
            complete: CompleteOptions::default(),
        }
    }
}

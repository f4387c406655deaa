//! Input and result of a search: options, the view, earlier rounds.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::plane::Plane;
use super::posed_image::PosedImage;

/// Options of PatchMatch.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct PatchMatchOptions {
    /// Minimum longer side of the coarsest level, 32–1024 pixels.
    pub coarsest_px: u32,
    /// Iterations at the coarsest level, 1–20.
    pub coarse_iterations: u32,
    /// Iterations at every finer level, 1–20.
    pub fine_iterations: u32,
    /// Iterations of a round with geometric consistency, 1–20.
    pub geometric_iterations: u32,
    /// Cost per pixel of forward-backward error, 0–1.
    pub geometric_weight: f32,
    /// Larger forward-backward errors are limited to this, 0.5–10 pixels.
    pub max_geometric_px: f32,
    /// Planes seen at a smaller cosine between normal and ray are not tried, 0.02–0.9.
    pub min_facing: f32,
    /// Maximum number of source views that the cost of a pixel is averaged over, 1–8.
    pub best_views: usize,
    /// Random depths per pixel and iteration at finer levels, and as many planes from more distant pixels, 0–8.
    pub restarts: u32,
    /// Hypotheses that differ by less than this are compared once, 0–1 pixels.
    pub alike_px: f32,
    /// Pixels with a lower variance of grey (0–255) are left out unless they lie within a surface, 0–100.
    pub min_variance: f32,
    /// Cost of differing from the surrounding surface, for a patch without texture that lies within one, 0–1.
    pub prior_weight: f32,
    /// Seed of the random hypotheses.
    pub seed: u32,
}

impl Default for PatchMatchOptions {
    fn default() -> Self {
        Self {
            coarsest_px: 120,
            coarse_iterations: 6,
            fine_iterations: 3,
            geometric_iterations: 1,
            geometric_weight: 0.3,
            max_geometric_px: 3.0,
            min_facing: 0.12,
            best_views: 3,
            restarts: 1,
            alike_px: 0.2,
            min_variance: 0.5,
            prior_weight: 0.6,
            seed: 0,
        }
    }
}

/// Input of the depth search of one view.
#[derive(Debug, Clone)]
pub struct DepthSearch<'a> {
    /// The view.
    pub reference: &'a PosedImage,
    /// Its sources, best first; only the first eight are used.
    pub sources: &'a [Arc<PosedImage>],
    /// Smallest and largest depth along the optical axis, in world units, above 0.
    pub depth_range: [f64; 2],
    /// Pixels (column, row, depth) whose depth is known from sparse points.
    pub seeds: &'a [(usize, usize, f32)],
    /// Pixels to process, row by row; `None` = all.
    pub allowed: Option<&'a [bool]>,
}

/// The best plane of every pixel, row by row, and its cost, 0–2; no plane where nothing was searched.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PlaneMap {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// The planes.
    pub planes: Vec<Plane>,
    /// Their costs.
    pub costs: Vec<f32>,
}

/// State from which a round with geometric consistency continues.
#[derive(Debug, Clone, Copy)]
pub struct Round<'a> {
    /// Planes of the view.
    pub start: &'a PlaneMap,
    /// Planes of each source; `None` if unknown.
    pub others: &'a [Option<Arc<PlaneMap>>],
    /// Number of such rounds before this one.
    pub before: u32,
}

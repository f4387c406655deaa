use serde::{Deserialize, Serialize};

use crate::points::OutlierOptions;

/// How frames become a labelled cloud.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct FuseOptions {
    /// Edge of a voxel in world units, above 0; every voxel that frames fill gives one point. `None` = what one pixel covers at the median depth, of the labelled pixels where there are
    /// some, or more where that gives more than about 4 million voxels.
    pub voxel: Option<f64>,
    /// Points whose label won a smaller share of the votes become unlabelled; 0–1.
    pub min_confidence: f32,
    /// Leave points without a label out (the noise suppression of OSTRA).
    pub drop_unlabelled: bool,
    /// Frames that must have measured a point, at least 1.
    pub min_views: u32,
    /// A pixel counts as one surface with a neighbour whose depth differs by at most this share of the depth; pixels
    /// with too few such neighbours fly between two surfaces and are left out. 0–1; 1 keeps every pixel.
    pub edge_tolerance: f32,
    /// A frame sees a point when their depths differ by at most this share of the depth, and one voxel; 0–1. `None` =
    /// measured: what nine tenths of the depths keep to.
    pub depth_tolerance: Option<f32>,
    /// Statistical outlier removal; `None` = off.
    pub outliers: Option<OutlierOptions>,
    /// Memory for the (frame, pixel) pairs that voted; beyond it they are not kept, and the report says so.
    pub pair_budget_bytes: usize,
}

impl Default for FuseOptions {
    fn default() -> Self {
        Self {
            voxel: None,
            min_confidence: 0.0,
            drop_unlabelled: false,
            min_views: 1,
            edge_tolerance: 0.02,
            depth_tolerance: None,
            outliers: None,
            pair_budget_bytes: 512 << 20,
        }
    }
}

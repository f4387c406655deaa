use glam::{DVec2, DVec3};

use crate::{Camera, Pose};

/// A bundle adjustment problem: cameras, image poses, points and observations.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Bundle {
    /// Intrinsics; several images may share one camera.
    pub cameras: Vec<Camera>,
    /// Images with their poses.
    pub images: Vec<BundleImage>,
    /// Points in world space.
    pub points: Vec<DVec3>,
    /// Observations, in any order.
    pub observations: Vec<BundleObservation>,
}

/// One image of a [`Bundle`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BundleImage {
    /// Index of its camera.
    pub camera: u32,
    /// Pose of the image: world space to camera space.
    pub camera_from_world: Pose,
}

/// One point seen in one image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BundleObservation {
    /// Index of the image.
    pub image: u32,
    /// Index of the point.
    pub point: u32,
    /// Observed position, pixels.
    pub at_px: DVec2,
}

/// Loss of a reprojection error of `r` px: the cost is `ρ(r²) / 2`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Loss {
    /// `r²`: best without outliers.
    Squared,
    /// `2 px² (√(1 + r²/px²) − 1)`: grows linearly beyond `px`.
    SoftL1 {
        /// Error at which the loss turns from squared to linear, pixels; above 0.
        px: f64,
    },
    /// `px² ln(1 + r²/px²)`: outliers have little influence.
    Cauchy {
        /// Error at which the loss begins to flatten, pixels; above 0.
        px: f64,
    },
}

impl Loss {
    /// Returns `ρ` of a squared error.
    pub(super) fn cost(self, squared: f64) -> f64 {
        match self {
            Self::Squared => squared,
            Self::SoftL1 { px } => 2.0 * px * px * ((1.0 + squared / (px * px)).sqrt() - 1.0),
            Self::Cauchy { px } => px * px * (squared / (px * px)).ln_1p(),
        }
    }

    /// Returns `ρ'` of a squared error, in (0, 1].
    ///
    /// This is the weight of an observation in iteratively reweighted least squares.
    pub(super) fn weight(self, squared: f64) -> f64 {
        match self {
            Self::Squared => 1.0,
            Self::SoftL1 { px } => 1.0 / (1.0 + squared / (px * px)).sqrt(),
            Self::Cauchy { px } => 1.0 / (1.0 + squared / (px * px)),
        }
    }
}

/// Intrinsics of a camera that are refined.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Refine {
    /// Focal lengths, by one common factor: their ratio is kept.
    pub focal: bool,
    /// Principal point.
    pub principal: bool,
    /// Coefficients of the camera's lens model.
    pub distortion: bool,
}

impl Refine {
    /// No intrinsics are refined.
    pub const NOTHING: Self = Self {
        focal: false,
        principal: false,
        distortion: false,
    };
}

/// Options of [`super::adjust`].
#[derive(Debug, Clone, PartialEq)]
pub struct BundleOptions {
    /// Loss of a reprojection error.
    pub loss: Loss,
    /// Maximum number of steps.
    pub max_iterations: usize,
    /// Relative decrease of the cost below which the adjustment has converged, e.g. 1e-6.
    pub function_tolerance: f64,
    /// Refined intrinsics per camera; [`Refine::NOTHING`] beyond the end of the list.
    pub refine: Vec<Refine>,
    /// Whether each image's pose is fixed; free beyond the end of the list.
    ///
    /// Without fixed images the whole may drift by a similarity, about as far as the noise moves
    /// it.
    pub fixed_images: Vec<bool>,
    /// Whether points are fixed, so that only cameras and poses are refined.
    pub fixed_points: bool,
}

impl Default for BundleOptions {
    fn default() -> Self {
        Self {
            loss: Loss::Squared,
            max_iterations: 50,
            function_tolerance: 1e-6,
            refine: Vec::new(),
            fixed_images: Vec::new(),
            fixed_points: false,
        }
    }
}

/// Result of an adjustment.
///
/// Costs are half the sum of the loss in px² over all observations that are used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BundleSummary {
    /// Number of steps tried.
    pub iterations: usize,
    /// Cost before the first step.
    pub initial_cost: f64,
    /// Cost after the best step.
    pub final_cost: f64,
    /// Whether the adjustment converged.
    pub converged: bool,
    /// Whether the caller stopped it.
    pub stopped: bool,
}

use glam::{DVec2, DVec3};

use crate::{Camera, Pose};

/// What is adjusted: cameras, where each image was taken, points, and where the points were seen.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Bundle {
    /// Intrinsics; several images may share one.
    pub cameras: Vec<Camera>,
    /// The images' poses.
    pub images: Vec<BundleImage>,
    /// In world space.
    pub points: Vec<DVec3>,
    /// In any order.
    pub observations: Vec<BundleObservation>,
}

/// One image of a [`Bundle`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BundleImage {
    /// Index of its camera.
    pub camera: u32,
    /// World space to camera space.
    pub camera_from_world: Pose,
}

/// One point seen in one image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BundleObservation {
    /// Index of the image.
    pub image: u32,
    /// Index of the point.
    pub point: u32,
    /// Where it was seen, in pixels.
    pub at_px: DVec2,
}

/// How much a reprojection error of `r` px costs: `ρ(r²) / 2`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Loss {
    /// `r²`: best without outliers.
    Squared,
    /// `2 px² (√(1 + r²/px²) − 1)`: grows linearly beyond `px`.
    SoftL1 {
        /// Where the loss turns from squared to linear, in pixels; above 0.
        px: f64,
    },
    /// `px² ln(1 + r²/px²)`: outliers hardly count.
    Cauchy {
        /// Where the loss begins to flatten, in pixels; above 0.
        px: f64,
    },
}

impl Loss {
    /// `ρ` of a squared error.
    pub(super) fn cost(self, squared: f64) -> f64 {
        match self {
            Self::Squared => squared,
            Self::SoftL1 { px } => 2.0 * px * px * ((1.0 + squared / (px * px)).sqrt() - 1.0),
            Self::Cauchy { px } => px * px * (squared / (px * px)).ln_1p(),
        }
    }

    /// `ρ'` of a squared error: the weight of an observation in iteratively reweighted least squares, in (0, 1].
    pub(super) fn weight(self, squared: f64) -> f64 {
        match self {
            Self::Squared => 1.0,
            Self::SoftL1 { px } => 1.0 / (1.0 + squared / (px * px)).sqrt(),
            Self::Cauchy { px } => 1.0 / (1.0 + squared / (px * px)),
        }
    }
}

/// Which intrinsics of a camera may change.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Refine {
    /// The focal lengths, by one common factor: their ratio stays.
    pub focal: bool,
    /// The principal point.
    pub principal: bool,
    /// The coefficients of the camera's own lens model.
    pub distortion: bool,
}

impl Refine {
    /// The intrinsics are known and stay as they are.
    pub const NOTHING: Self = Self {
        focal: false,
        principal: false,
        distortion: false,
    };
}

/// What [`super::adjust`] may change, and when it ends.
#[derive(Debug, Clone, PartialEq)]
pub struct BundleOptions {
    /// The cost of an error.
    pub loss: Loss,
    /// Steps tried at most.
    pub max_iterations: usize,
    /// It ends when a step lowers the cost by less than this share, e.g. 1e-6.
    pub function_tolerance: f64,
    /// One per camera; [`Refine::NOTHING`] where the list is shorter.
    pub refine: Vec<Refine>,
    /// One per image, `true` where its pose stays; free where the list is shorter. Without fixed images the whole may
    /// drift by a similarity, about as far as the noise moves it.
    pub fixed_images: Vec<bool>,
    /// Whether only cameras and poses move.
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

/// How an adjustment went. A cost is half the sum of the loss in px² over all observations that take part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BundleSummary {
    /// Steps tried.
    pub iterations: usize,
    /// Before the first step.
    pub initial_cost: f64,
    /// After the best step.
    pub final_cost: f64,
    /// Whether the last step changed next to nothing.
    pub converged: bool,
    /// Whether the caller broke off.
    pub stopped: bool,
}

use glam::DMat3;

use crate::Pose;

/// When matches agree, and how long to look for agreement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TwoViewOptions {
    /// Largest error of an inlier in pixels.
    pub max_error_px: f64,
    /// Wanted probability of having drawn a sample without outliers.
    pub confidence: f64,
    /// Fewer inliers are no agreement.
    pub min_inliers: usize,
    /// Samples at most per model.
    pub max_iterations: usize,
    /// Seed of the samples.
    pub seed: u64,
}

impl Default for TwoViewOptions {
    fn default() -> Self {
        Self {
            max_error_px: 4.0,
            confidence: 0.999,
            min_inliers: 15,
            max_iterations: 2000,
            seed: 0,
        }
    }
}

/// What two views have in common.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TwoViewKind {
    /// The intrinsics hold: an essential matrix explains the inliers as well as a fundamental matrix.
    Calibrated,
    /// Intrinsics are guesses, or a fundamental matrix explains clearly more than an essential matrix.
    Uncalibrated,
    /// A homography explains nearly all inliers, and the camera moved.
    Planar,
    /// A rotation of the camera explains nearly all inliers.
    Panoramic,
}

/// What two views have in common, and the motion between them.
#[derive(Debug, Clone, PartialEq)]
pub struct TwoView {
    /// Which model explains the inliers.
    pub kind: TwoViewKind,
    /// Motion of the camera with a translation of length 1; `None` without parallax, and where no motion puts most
    /// points in front of both cameras.
    pub second_from_first: Option<Pose>,
    /// Indices of the matches that agree, ascending.
    pub inliers: Vec<u32>,
    /// Median angle between the rays of inliers that lie in front of both cameras, in radians; 0 without a motion.
    pub parallax: f64,
    /// `F` with `x2ᵀ F x1 = 0` between pixels (lens distortion removed), Frobenius norm 1; `None` for panoramic views.
    pub fundamental: Option<DMat3>,
}

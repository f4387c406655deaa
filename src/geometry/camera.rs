use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

/// Lens distortion, with the parameters and formulas of the COLMAP camera model of the same name.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Distortion {
    /// `PINHOLE`, `SIMPLE_PINHOLE`.
    #[default]
    None,
    /// `SIMPLE_RADIAL` (k2 = 0) and `RADIAL`: `1 + k1 r² + k2 r⁴`.
    Radial {
        /// k1, k2.
        k: [f64; 2],
    },
    /// `OPENCV`: k1, k2, p1, p2.
    OpenCv {
        /// Radial k1, k2.
        k: [f64; 2],
        /// Tangential p1, p2.
        p: [f64; 2],
    },
    /// `FULL_OPENCV`: k1, k2, p1, p2, k3, k4, k5, k6 (rational).
    FullOpenCv {
        /// Radial k1 … k6.
        k: [f64; 6],
        /// Tangential p1, p2.
        p: [f64; 2],
    },
    /// `OPENCV_FISHEYE`: equidistant, k1 … k4.
    OpenCvFisheye {
        /// k1 … k4.
        k: [f64; 4],
    },
    /// `THIN_PRISM_FISHEYE`: k1, k2, p1, p2, k3, k4, sx1, sy1.
    ThinPrismFisheye {
        /// k1 … k4.
        k: [f64; 4],
        /// p1, p2.
        p: [f64; 2],
        /// Thin prism sx1, sy1.
        s: [f64; 2],
    },
}

/// A camera's intrinsics. Pixel space: centre of the top-left pixel at (0.5, 0.5); camera space: OpenCV axes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// Picture width in pixels.
    pub width: u32,
    /// Picture height in pixels.
    pub height: u32,
    /// Focal lengths in pixels.
    pub focal_px: DVec2,
    /// Principal point in pixels.
    pub principal_px: DVec2,
    /// Lens distortion.
    #[serde(default)]
    pub distortion: Distortion,
}

impl Camera {
    /// A pinhole camera without distortion.
    #[must_use]
    pub fn pinhole(width: u32, height: u32, fx: f64, fy: f64, cx: f64, cy: f64) -> Self {
        Self {
            width,
            height,
            focal_px: DVec2::new(fx, fy),
            principal_px: DVec2::new(cx, cy),
            distortion: Distortion::None,
        }
    }

    /// Pixel position of a point in camera space; `None` behind the camera (or outside what the lens model covers).
    /// The position may lie outside the picture.
    #[must_use]
    pub fn project(&self, x_in_camera: DVec3) -> Option<DVec2> {
        if x_in_camera.z <= 0.0 {
            return None;
        }
        Some(x_in_camera.truncate() / x_in_camera.z * self.focal_px + self.principal_px)
    }

    /// The point on the plane z = 1 of camera space that is seen at `at_px`. A point at `depth` along the optical
    /// axis is `depth · (x, y, 1)`.
    #[must_use]
    pub fn unproject(&self, at_px: DVec2) -> DVec2 {
        (at_px - self.principal_px) / self.focal_px
    }
}

use glam::{DMat2, DVec2, DVec3, Vec2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Distortion;

/// A camera's intrinsics.
///
/// Pixel space: the centre of the top-left pixel is at (0.5, 0.5). Camera space: OpenCV axes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "StoredCamera")]
#[schemars(!try_from)]
pub struct Camera {
    /// Image width in pixels.
    pub width: u32,
    /// Image height in pixels.
    pub height: u32,
    /// Focal lengths in pixels.
    #[schemars(with = "[f64; 2]")]
    pub focal_px: DVec2,
    /// Principal point in pixels.
    #[schemars(with = "[f64; 2]")]
    pub principal_px: DVec2,
    /// Lens distortion.
    #[serde(default)]
    pub distortion: Distortion,
}

/// A camera as read from a file, before it is validated.
#[derive(Deserialize)]
struct StoredCamera {
    width: u32,
    height: u32,
    focal_px: DVec2,
    principal_px: DVec2,
    #[serde(default)]
    distortion: Distortion,
}

impl TryFrom<StoredCamera> for Camera {
    type Error = String;

    /// Rejects values that are not finite and sizes that no image has.
    ///
    /// This happens before anything of that size is allocated.
    fn try_from(stored: StoredCamera) -> Result<Self, String> {
        let StoredCamera {
            width,
            height,
            focal_px,
            principal_px,
            distortion,
        } = stored;
        let sides = 1..=Self::MAX_SIDE;
        if !sides.contains(&width)
            || !sides.contains(&height)
            || u64::from(width) * u64::from(height) > Self::MAX_PIXELS
        {
            return Err(format!(
                "a camera of {width} × {height} pixels is not possible (at most {} a side and {} million in all)",
                Self::MAX_SIDE,
                Self::MAX_PIXELS / 1_000_000
            ));
        }
        if !(focal_px.is_finite() && focal_px.min_element() > 0.0 && principal_px.is_finite()) {
            return Err(format!(
                "a camera with focal lengths {}, {} and principal point {}, {} is not possible",
                focal_px.x, focal_px.y, principal_px.x, principal_px.y
            ));
        }
        Ok(Self {
            width,
            height,
            focal_px,
            principal_px,
            distortion,
        })
    }
}

impl Camera {
    /// Maximum length of an image's side, pixels: JPEG cannot store more.
    pub const MAX_SIDE: u32 = 65_535;
    /// Maximum number of pixels of an image.
    ///
    /// This is somewhat more than the largest sensors of phones and cameras have (200 million).
    /// Decoded, such an image takes 660 MB.
    pub const MAX_PIXELS: u64 = 220_000_000;

    /// Creates a pinhole camera without distortion.
    ///
    /// `focal_px` holds the focal lengths and `principal_px` the principal point, each for x and y.
    #[must_use]
    #[inline]
    pub fn pinhole(width: u32, height: u32, focal_px: [f64; 2], principal_px: [f64; 2]) -> Self {
        Self {
            width,
            height,
            focal_px: focal_px.into(),
            principal_px: principal_px.into(),
            distortion: Distortion::None,
        }
    }

    /// Projects a point in camera space to a pixel position.
    ///
    /// The position may lie outside the image. Returns `None` behind the camera, for NaN, and where
    /// the lens model folds back (points far outside the image).
    #[must_use]
    #[inline]
    pub fn project(&self, x_in_camera: DVec3) -> Option<DVec2> {
        if x_in_camera.z.is_nan() || x_in_camera.z <= 0.0 {
            return None;
        }
        let at_plane = x_in_camera.truncate() / x_in_camera.z;
        let distorted = match self.distortion.terms() {
            None => at_plane,
            Some(lens) => lens.distort(at_plane)?,
        };
        Some(distorted * self.focal_px + self.principal_px)
    }

    /// Returns the point on the plane z = 1 of camera space that is seen at `at_px`.
    ///
    /// A point at `depth` along the optical axis is `depth · (x, y, 1)`. Returns NaN where the lens
    /// covers no such point (a fisheye at 90° from its axis).
    #[must_use]
    #[inline]
    pub fn unproject(&self, at_px: DVec2) -> DVec2 {
        let distorted = (at_px - self.principal_px) / self.focal_px;
        match self.distortion.terms() {
            None => distorted,
            Some(lens) => lens.undistort(distorted),
        }
    }

    /// Applies [`Self::unproject`] to pixel centres of `row`, from column 0 to the end of `rays`.
    ///
    /// For dense loops over rows in parallel.
    #[inline]
    pub fn unproject_row(&self, row: u32, rays: &mut [Vec2]) {
        let y = f64::from(row) + 0.5;
        for (column, ray) in rays.iter_mut().enumerate() {
            *ray = self.unproject(DVec2::new(column as f64 + 0.5, y)).as_vec2();
        }
    }

    /// Returns whether a position lies in the image.
    #[must_use]
    #[inline]
    pub fn contains(&self, at_px: DVec2) -> bool {
        at_px.x >= 0.0
            && at_px.y >= 0.0
            && at_px.x < f64::from(self.width)
            && at_px.y < f64::from(self.height)
    }
}

/// Step of the difference quotient on the plane z = 1.
const STEP: f64 = 1e-5;

/// Returns the derivative of the pixel position by the position on the plane z = 1.
///
/// `None` where the lens model folds back.
pub(crate) fn pixel_slope(camera: &Camera, at_plane: DVec2) -> Option<DMat2> {
    if camera.distortion == Distortion::None {
        return Some(DMat2::from_diagonal(camera.focal_px));
    }
    let at = |offset: DVec2| camera.project((at_plane + offset).extend(1.0));
    let along = |axis: DVec2| Some((at(axis * STEP)? - at(axis * -STEP)?) / (2.0 * STEP));
    Some(DMat2::from_cols(along(DVec2::X)?, along(DVec2::Y)?))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Returns one camera of every model, with realistic coefficients.
    fn cameras() -> Vec<Camera> {
        let models = [
            Distortion::None,
            Distortion::Radial { k: [-0.2, 0.03] },
            Distortion::OpenCv {
                k: [-0.28, 0.07],
                p: [1e-3, -2e-3],
            },
            Distortion::FullOpenCv {
                k: [0.3, 0.05, 0.002, 0.5, 0.03, 0.001],
                p: [-1e-3, 5e-4],
            },
            Distortion::OpenCvFisheye {
                k: [0.05, -0.01, 0.004, -0.001],
            },
            Distortion::ThinPrismFisheye {
                k: [0.02, -0.01, 0.003, 1e-3],
                p: [4e-3, -7e-3],
                s: [3e-3, 5e-3],
            },
        ];
        let base = Camera::pinhole(640, 480, [500.0, 510.0], [322.0, 237.5]);
        models
            .into_iter()
            .map(|distortion| Camera { distortion, ..base })
            .collect()
    }

    #[test]
    fn lens_folds_back_at_the_radius_where_its_derivative_is_zero() {
        let base = Camera::pinhole(640, 480, [500.0, 500.0], [320.0, 240.0]);
        let project = |k: [f64; 2], radius: f64| {
            let distortion = Distortion::Radial { k };
            Camera { distortion, ..base }.project(glam::DVec3::new(radius, 0.0, 1.0))
        };
        // 1 + 3 k1 r² is zero at r = 1.
        let k = [-1.0 / 3.0, 0.0];
        assert!(project(k, 0.99).is_some() && project(k, 1.01).is_none());
        // Here a positive k2 outweighs k1: 1 + 3 k1 r² + 5 k2 r⁴ is above zero everywhere.
        let k = [-1.0 / 3.0, 0.06];
        assert!(
            [0.5, 1.0, 3.0]
                .iter()
                .all(|&radius| project(k, radius).is_some())
        );
        assert!(project([f64::NAN, 0.0], 0.5).is_none());
    }

    proptest! {
        #[test]
        fn project_undoes_unproject(x in 0.0..640.0f64, y in 0.0..480.0f64, depth in 0.1..100.0f64) {
            for camera in cameras() {
                let ray = camera.unproject(DVec2::new(x, y));
                let back = camera.project(depth * ray.extend(1.0));
                prop_assert!(back.is_some_and(|at| at.abs_diff_eq(DVec2::new(x, y), 1e-6)), "{camera:?}: {back:?}");
            }
        }
    }

    #[test]
    fn distortion_follows_the_published_formulas() {
        // Computed by hand at (u, v) = (0.3, 0.4): r² = 0.25.
        let x = DVec3::new(0.6, 0.8, 2.0);
        let unit = Camera::pinhole(10, 10, [1.0, 1.0], [0.0, 0.0]);
        let at = |distortion| Camera { distortion, ..unit }.project(x).unwrap();
        assert!(
            at(Distortion::Radial { k: [0.1, 0.2] })
                .abs_diff_eq(DVec2::new(0.3, 0.4) * 1.0375, 1e-12)
        );
        let tangential = at(Distortion::OpenCv {
            k: [0.0, 0.0],
            p: [0.01, 0.02],
        });
        assert!(tangential.abs_diff_eq(
            DVec2::new(0.3 + 0.0024 + 0.0086, 0.4 + 0.0048 + 0.0057),
            1e-12
        ));
        let angle = 0.5f64.atan();
        let fisheye = at(Distortion::OpenCvFisheye {
            k: [0.1, 0.0, 0.0, 0.0],
        });
        assert!(fisheye.abs_diff_eq(
            DVec2::new(0.6, 0.8) * angle * (1.0 + 0.1 * angle * angle),
            1e-12
        ));
        let rational = at(Distortion::FullOpenCv {
            k: [0.1, 0.0, 0.0, 0.2, 0.0, 0.0],
            p: [0.0; 2],
        });
        assert!(rational.abs_diff_eq(DVec2::new(0.3, 0.4) * 1.025 / 1.05, 1e-12));
        let prism = at(Distortion::ThinPrismFisheye {
            k: [0.0; 4],
            p: [0.0; 2],
            s: [0.01, 0.02],
        });
        let drawn_in = DVec2::new(0.6, 0.8) * angle;
        assert!(prism.abs_diff_eq(drawn_in + angle * angle * DVec2::new(0.01, 0.02), 1e-12));
    }

    #[test]
    fn point_beyond_the_fold_is_not_projected() {
        // 1 − 0.3 r² folds back at r = 1.05: a point at r = 1.7 would be projected into the image.
        let camera = Camera {
            distortion: Distortion::Radial { k: [-0.3, 0.0] },
            ..Camera::pinhole(640, 480, [300.0, 300.0], [320.0, 240.0])
        };
        assert_eq!(camera.project(DVec3::new(1.7, 0.0, 1.0)), None);
        assert!(camera.project(DVec3::new(0.9, 0.0, 1.0)).is_some());
        assert!(camera.unproject(DVec2::new(640.0, 240.0)).is_nan());
    }

    #[test]
    fn points_behind_the_camera_and_nan_are_not_projected() {
        for camera in cameras() {
            assert_eq!(camera.project(DVec3::new(0.1, 0.1, -1.0)), None);
            assert_eq!(camera.project(DVec3::new(0.1, 0.1, f64::NAN)), None);
        }
    }

    #[test]
    fn row_of_rays_equals_single_pixels() {
        for camera in cameras() {
            let mut rays = vec![Vec2::ZERO; 640];
            camera.unproject_row(17, &mut rays);
            let single = camera.unproject(DVec2::new(600.5, 17.5));
            assert_eq!(rays[600], single.as_vec2());
        }
    }
}

use glam::{DVec2, Vec2, Vec3};

use crate::sfm::{for_each_source, undistorted_camera};
use ostra_frames::{DepthMap, Image};
use ostra_geometry::{Camera, is_same_depth};

/// Longest side of the images that registration uses, in pixels.
const SIDE: u32 = 320;
/// Depths that differ by less than this share belong to one surface.
pub(super) const SAME_SURFACE: f32 = 0.03;

/// A frame as registration stores it: small, without lens distortion, 3 bytes per pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct RgbdImage {
    /// The pinhole camera of these pixels.
    pub camera: Camera,
    /// Luma, 0–255.
    pub grey: Vec<u8>,
    /// Depth in steps of `unit`; 0 = unknown.
    depths: Vec<u16>,
    /// World units per step.
    unit: f32,
}

impl RgbdImage {
    /// Shrinks a frame. Image and depth have the camera's size.
    #[must_use]
    pub fn new(image: &Image, depth: &DepthMap, camera: &Camera) -> Self {
        let small = shrunk(&undistorted_camera(camera));
        let cell = f64::from(camera.width) / f64::from(small.width);
        let mut pixels = vec![(0u8, 0.0f32); small.width as usize * small.height as usize];
        for_each_source(&mut pixels, camera, &small, |at_px| {
            let cell = Cell::around(at_px, cell, camera);
            (cell.grey(image), cell.depth(depth, at_px))
        });
        let farthest = pixels
            .iter()
            .map(|pixel| pixel.1)
            .fold(f32::MIN_POSITIVE, f32::max);
        let unit = farthest / f32::from(u16::MAX);
        let depths = pixels
            .iter()
            .map(|pixel| (pixel.1 / unit).round() as u16)
            .collect();
        Self {
            camera: small,
            grey: pixels.iter().map(|pixel| pixel.0).collect(),
            depths,
            unit,
        }
    }

    /// Returns the view with depth alone, and an image without content.
    #[must_use]
    pub fn without_image(&self) -> Self {
        Self {
            grey: vec![0; self.grey.len()],
            ..self.clone()
        }
    }

    /// Returns the depth of a pixel in world units; 0 = unknown.
    #[must_use]
    pub fn depth(&self, pixel: usize) -> f32 {
        f32::from(self.depths[pixel]) * self.unit
    }

    /// Returns the share of the pixels with known depth.
    #[must_use]
    pub fn known(&self) -> f64 {
        self.depths.iter().filter(|&&depth| depth > 0).count() as f64
            / self.depths.len().max(1) as f64
    }

    /// Returns the mean of the known depths, in world units; 0 without any.
    #[must_use]
    pub fn mean_depth(&self) -> f64 {
        let (sum, count) = self
            .depths
            .iter()
            .fold((0u64, 0u64), |(sum, count), &depth| {
                (sum + u64::from(depth), count + u64::from(depth > 0))
            });
        sum as f64 / count.max(1) as f64 * f64::from(self.unit)
    }

    /// Returns the point that a pixel of known depth shows, in the camera's axes.
    #[must_use]
    pub fn point(&self, pixel: usize) -> Option<Vec3> {
        let depth = self.depth(pixel);
        let (x, y) = (
            pixel as u32 % self.camera.width,
            pixel as u32 / self.camera.width,
        );
        let at_px = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
        let ray = (at_px - self.camera.principal_px.as_vec2()) / self.camera.focal_px.as_vec2();
        (depth > 0.0).then(|| ray.extend(1.0) * depth)
    }
}

/// Returns the same camera with images of at most [`SIDE`] pixels.
fn shrunk(camera: &Camera) -> Camera {
    let longest = camera.width.max(camera.height).max(1);
    let share = (f64::from(SIDE) / f64::from(longest)).min(1.0);
    let side = |length: u32| ((f64::from(length) * share).round() as u32).max(1);
    let (width, height) = (side(camera.width), side(camera.height));
    let by = DVec2::new(
        f64::from(width) / f64::from(camera.width),
        f64::from(height) / f64::from(camera.height),
    );
    Camera {
        width,
        height,
        focal_px: camera.focal_px * by,
        principal_px: camera.principal_px * by,
        ..*camera
    }
}

/// The pixels of the frame that one pixel of the small image covers.
struct Cell {
    columns: std::ops::Range<u32>,
    rows: std::ops::Range<u32>,
}

impl Cell {
    fn around(at_px: DVec2, side: f64, camera: &Camera) -> Self {
        let range = |middle: f64, length: u32| {
            let first = ((middle - 0.5 * side).round().max(0.0) as u32).min(length - 1);
            first..((middle + 0.5 * side).round() as u32).clamp(first + 1, length)
        };
        Self {
            columns: range(at_px.x, camera.width),
            rows: range(at_px.y, camera.height),
        }
    }

    fn pixels(&self) -> impl Iterator<Item = (u32, u32)> + '_ {
        self.rows
            .clone()
            .flat_map(|y| self.columns.clone().map(move |x| (x, y)))
    }

    /// Returns the mean luma as in ITU-R BT.601.
    fn grey(&self, image: &Image) -> u8 {
        let (mut sum, mut count) = (0u32, 0);
        for (x, y) in self.pixels() {
            let [r, g, b] = image.at(x, y).map(u32::from);
            sum += 299 * r + 587 * g + 114 * b;
            count += 1000;
        }
        ((sum + count / 2) / count.max(1)) as u8
    }

    /// Returns the mean depth of the surface of the known pixel nearest to the middle.
    fn depth(&self, depth: &DepthMap, middle: DVec2) -> f32 {
        let known = |&(x, y): &(u32, u32)| {
            let depth = depth.at(x, y);
            depth.is_finite() && depth > 0.0
        };
        let off = |&(x, y): &(u32, u32)| {
            DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5).distance_squared(middle)
        };
        let nearest = self
            .pixels()
            .filter(known)
            .min_by(|a, b| off(a).total_cmp(&off(b)));
        let Some((x, y)) = nearest else { return 0.0 };
        let own = depth.at(x, y);
        let (mut sum, mut count) = (0.0, 0.0);
        for (x, y) in self.pixels().filter(known) {
            let other = depth.at(x, y);
            if is_same_depth(other, own, SAME_SURFACE) {
                sum += other;
                count += 1.0;
            }
        }
        sum / count
    }
}

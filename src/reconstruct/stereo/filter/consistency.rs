use std::sync::Arc;

use glam::{Mat3, Vec3};
use serde::{Deserialize, Serialize};

use crate::stereo::DepthEstimate;
use crate::stereo::patchmatch::{Plane, PosedImage, Raster, Texture, Transfer};

/// When the depths of two views show the same surface.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct DepthAgreement {
    /// Maximum difference of depth as a share of it, 0–1.
    pub depth: f32,
    /// Maximum distance after projecting there and back, in pixels of the raster, above 0.
    pub reprojection_px: f32,
    /// Minimum cosine between the normals, −1–1; the normals of parts a pixel or two wide are hardly known.
    pub normal_cosine: f32,
}

impl Default for DepthAgreement {
    fn default() -> Self {
        Self {
            depth: 0.01,
            reprojection_px: 2.0,
            normal_cosine: 0.09,
        }
    }
}

/// Stands for no pixel of a neighbour.
pub const UNSEEN: u32 = u32::MAX;

/// Another view's depths, seen from a view.
#[derive(Debug, Clone)]
pub struct Neighbour {
    estimate: Arc<DepthEstimate>,
    texture: Arc<Texture>,
    raster: Raster,
    transfer: Transfer,
    back: Transfer,
    /// Inverse depth there, per inverse depth here: `z' = (row · (x, y, 1) / w + t) `.
    here_from_there: Mat3,
}

/// A neighbour's pixel that sees the same point as a pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConsistentPixel {
    /// Index of the neighbour's pixel, row by row.
    pub pixel: usize,
    /// Inverse depth of the neighbour's plane along the pixel's own ray.
    pub inverse_depth: f32,
    /// The neighbour's normal in the pixel's own camera space.
    pub normal: Vec3,
}

impl Neighbour {
    /// Prepares a neighbour of `view`.
    #[must_use]
    pub fn new(view: &PosedImage, other: &PosedImage, estimate: Arc<DepthEstimate>) -> Self {
        let here_from_there = view
            .camera_from_world
            .compose(&other.camera_from_world.inverse());
        Self {
            estimate,
            texture: Arc::clone(&other.levels[0]),
            raster: other.raster(0),
            transfer: view.transfer(other, 0),
            back: other.transfer(view, 0),
            here_from_there: glam::DMat3::from_quat(here_from_there.rotation).as_mat3(),
        }
    }

    /// Returns the neighbour's pixel that sees the point of a pixel, if its depth agrees.
    ///
    /// The nearest of the four pixels around the projection is tried first, then the others,
    /// because thin parts lie between pixels.
    #[must_use]
    pub fn matched(
        &self,
        point: &PixelPoint,
        agreement: &DepthAgreement,
    ) -> Option<ConsistentPixel> {
        let [u, v, z] = self.transfer.apply(point.x, point.y, point.inverse_depth);
        if z <= 0.0 {
            return None;
        }
        let (u, v) = (u / z, v / z);
        let (column, row) = ((u + 0.5).floor(), (v + 0.5).floor());
        let (adjacent, below) = (2.0 * u.floor() + 1.0 - column, 2.0 * v.floor() + 1.0 - row);
        let around = [
            (column, row),
            (adjacent, row),
            (column, below),
            (adjacent, below),
        ];
        let seen = NeighbourView { point, u, v };
        around
            .into_iter()
            .find_map(|(column, row)| self.agreeing(&seen, column, row, agreement))
    }

    /// Returns for each pixel of a view of `width · height` pixels the neighbour's pixel that is seen nearest there.
    ///
    /// [`UNSEEN`] where there is none.
    #[must_use]
    pub fn projected(&self, width: usize, height: usize) -> Vec<u32> {
        let mut seen = vec![UNSEEN; width * height];
        let mut nearest = vec![0.0; seen.len()];
        for (pixel, &depth) in self
            .estimate
            .depths
            .iter()
            .enumerate()
            .filter(|&(_, &depth)| depth > 0.0)
        {
            let (x, y, inverse_depth) = self.place(pixel, depth);
            let (column, row) = ((x + 0.5).floor(), (y + 0.5).floor());
            let is_inside =
                column >= 0.0 && row >= 0.0 && column < width as f32 && row < height as f32;
            if !is_inside || inverse_depth <= 0.0 {
                continue;
            }
            let at = row as usize * width + column as usize;
            if inverse_depth > nearest[at] {
                (nearest[at], seen[at]) = (inverse_depth, pixel as u32);
            }
        }
        seen
    }

    /// Returns the surface of one of its pixels in the view; `None` if depth is unknown, and for [`UNSEEN`].
    #[must_use]
    pub fn surface(&self, pixel: u32) -> Option<NeighbourSurface> {
        let pixel = pixel as usize;
        let depth = self
            .estimate
            .depths
            .get(pixel)
            .copied()
            .filter(|&depth| depth > 0.0)?;
        let (_, _, inverse_depth) = self.place(pixel, depth);
        let normal = self.here_from_there * self.estimate.normal(pixel);
        Some(NeighbourSurface {
            inverse_depth,
            normal,
            confidence: self.estimate.confidence[pixel],
        })
    }

    /// Returns the difference of colour between a pixel and pixel `at` of `texture`, in squared grey levels.
    ///
    /// # Panics
    /// If the neighbour's image came without its pixels.
    #[must_use]
    pub fn color_difference(&self, pixel: usize, texture: &Texture, at: usize) -> f32 {
        texture.color_difference(at, &self.texture, pixel)
    }

    /// Returns where the view sees a pixel of known depth, and its inverse depth there.
    fn place(&self, pixel: usize, depth: f32) -> (f32, f32, f32) {
        let width = self.estimate.width();
        let [x, y, z] =
            self.back
                .apply((pixel % width) as f32, (pixel / width) as f32, 1.0 / depth);
        (x / z, y / z, 1.0 / (depth * z))
    }

    /// Returns the neighbour's pixel in a column and row, if it agrees.
    fn agreeing(
        &self,
        seen: &NeighbourView<'_>,
        column: f32,
        row: f32,
        agreement: &DepthAgreement,
    ) -> Option<ConsistentPixel> {
        let (width, height) = (self.estimate.width(), self.estimate.height());
        if column < 0.0 || row < 0.0 || column >= width as f32 || row >= height as f32 {
            return None;
        }
        let pixel = row as usize * width + column as usize;
        let depth = self.estimate.depths[pixel];
        if depth <= 0.0 {
            return None;
        }
        let NeighbourView { point, u, v } = *seen;
        let there = self.estimate.normal(pixel);
        let plane =
            Plane::from_normal(depth, there, &self.raster, column, row).moved(u - column, v - row);
        let [s, t, w] = self.back.apply(u, v, plane.inverse_depth);
        let (s, t) = (s / w - point.x, t / w - point.y);
        // Depth here of the point that is seen there, as a share of the depth here.
        let ratio = w / plane.inverse_depth * point.inverse_depth;
        let normal = self.here_from_there * there;
        let agrees = (ratio - 1.0).abs() <= agreement.depth
            && s * s + t * t <= agreement.reprojection_px * agreement.reprojection_px
            && normal.dot(point.normal) >= agreement.normal_cosine;
        agrees.then(|| ConsistentPixel {
            pixel,
            inverse_depth: point.inverse_depth / ratio,
            normal,
        })
    }
}

/// A neighbour's surface as a view sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NeighbourSurface {
    /// Inverse depth; below 0 if behind the view.
    pub inverse_depth: f32,
    /// Normal in the view's camera space.
    pub normal: Vec3,
    /// How well the neighbour's sources agree with it, 0–255.
    pub confidence: u8,
}

/// The point that a pixel of a view sees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelPoint {
    /// Column of the pixel.
    pub x: f32,
    /// Row of the pixel.
    pub y: f32,
    /// Inverse depth.
    pub inverse_depth: f32,
    /// Normal in the view's camera space.
    pub normal: Vec3,
}

impl PixelPoint {
    /// Creates the point of a pixel, given by index, of an image `width` pixels wide.
    #[must_use]
    pub fn new(pixel: usize, width: usize, inverse_depth: f32, normal: Vec3) -> Self {
        Self {
            x: (pixel % width) as f32,
            y: (pixel / width) as f32,
            inverse_depth,
            normal,
        }
    }
}

/// A pixel's point, and the position where a neighbour sees it.
struct NeighbourView<'a> {
    point: &'a PixelPoint,
    u: f32,
    v: f32,
}

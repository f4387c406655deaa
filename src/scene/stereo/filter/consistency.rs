use std::sync::Arc;

use glam::{Mat3, Vec3};

use super::options::Agreement;
use crate::scene::stereo::DepthEstimate;
use crate::scene::stereo::patchmatch::{Picture, Plane, Raster, Transfer};

/// Another view's depths beside a view.
#[derive(Debug, Clone)]
pub struct Neighbour {
    estimate: Arc<DepthEstimate>,
    raster: Raster,
    transfer: Transfer,
    back: Transfer,
    /// Inverse depth there, per inverse depth here: `z' = (row · (x, y, 1) / w + t) `.
    here_from_there: Mat3,
}

/// A neighbour's pixel that sees what a pixel sees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Match {
    /// The neighbour's pixel, row by row.
    pub pixel: usize,
    /// Inverse depth that the neighbour's plane gives along the pixel's own ray.
    pub inverse_depth: f32,
    /// The neighbour's normal in the pixel's own camera space.
    pub normal: Vec3,
}

impl Neighbour {
    /// Prepares a neighbour of `view`.
    #[must_use]
    pub fn new(view: &Picture, other: &Picture, estimate: Arc<DepthEstimate>) -> Self {
        let here_from_there = view.camera_from_world.compose(&other.camera_from_world.inverse());
        Self {
            estimate,
            raster: other.raster(0),
            transfer: view.transfer(other, 0),
            back: other.transfer(view, 0),
            here_from_there: glam::DMat3::from_quat(here_from_there.rotation).as_mat3(),
        }
    }

    /// The neighbour's pixel that sees the point of a pixel `(x, y)` at `inverse_depth` with `normal`, where its depth
    /// agrees: the nearest of the four around the place, else another of them, as thin parts lie between pixels.
    #[must_use]
    pub fn matched(
        &self,
        (x, y): (f32, f32),
        inverse_depth: f32,
        normal: Vec3,
        agreement: &Agreement,
    ) -> Option<Match> {
        let [u, v, z] = self.transfer.apply(x, y, inverse_depth);
        if z <= 0.0 {
            return None;
        }
        let (u, v) = (u / z, v / z);
        let (column, row) = ((u + 0.5).floor(), (v + 0.5).floor());
        let (beside, below) = (2.0 * u.floor() + 1.0 - column, 2.0 * v.floor() + 1.0 - row);
        let around = [(column, row), (beside, row), (column, below), (beside, below)];
        let point = Seen { at: (x, y), there: (u, v), inverse_depth, normal };
        around.into_iter().find_map(|pixel| self.agreeing(&point, pixel, agreement))
    }

    /// The neighbour's pixel in a column and row, where it agrees.
    fn agreeing(&self, point: &Seen, (column, row): (f32, f32), agreement: &Agreement) -> Option<Match> {
        let (width, height) = (self.estimate.width(), self.estimate.height());
        if column < 0.0 || row < 0.0 || column >= width as f32 || row >= height as f32 {
            return None;
        }
        let pixel = row as usize * width + column as usize;
        let depth = self.estimate.depths[pixel];
        if depth <= 0.0 {
            return None;
        }
        let (u, v) = point.there;
        let there = self.estimate.normal(pixel);
        let plane = Plane::from_normal(depth, there, &self.raster, column, row).moved(u - column, v - row);
        let [s, t, w] = self.back.apply(u, v, plane.inverse_depth);
        let (s, t) = (s / w - point.at.0, t / w - point.at.1);
        // Depth here of what is seen there, as a share of the depth here.
        let ratio = w / plane.inverse_depth * point.inverse_depth;
        let normal = self.here_from_there * there;
        let agrees = (ratio - 1.0).abs() <= agreement.depth
            && s * s + t * t <= agreement.reprojection_px * agreement.reprojection_px
            && normal.dot(point.normal) >= agreement.normal_cosine;
        agrees.then(|| Match { pixel, inverse_depth: point.inverse_depth / ratio, normal })
    }
}

/// A pixel's point and where a neighbour sees it.
struct Seen {
    at: (f32, f32),
    there: (f32, f32),
    inverse_depth: f32,
    normal: Vec3,
}

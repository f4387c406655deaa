use std::ops::Range;

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::model::SceneMesh;
use ostra_geometry::{Camera, Pose};

/// Marks a sample without a triangle.
pub(super) const NOTHING: u32 = u32::MAX;
/// Surfaces nearer than this are not drawn, in metres.
const NEAR_M: f64 = 0.01;

/// A triangle in the view of a camera, in homogeneous form, which needs no clipping.
///
/// Source: Olano, Greer, "Triangle scan conversion using 2D homogeneous coordinates", Graphics
/// Hardware 1997. Depth is exact.
#[derive(Debug, Clone, Copy)]
pub(super) struct Facet {
    /// Edge normals; a ray `d` with z = 1 hits the triangle where all `edges[k] · d` ≥ 0.
    edges: [DVec3; 3],
    /// Six times the volume of the tetrahedron of camera centre and triangle, ≥ 0.
    volume: f64,
    /// Bounding box in pixels.
    low: DVec2,
    high: DVec2,
}

/// All triangles in the view of one camera, sorted into bands of image rows.
pub(super) struct Raster<'a> {
    model: &'a SceneMesh,
    camera: Camera,
    pub(super) world_from_camera: Pose,
    x_in_camera: Vec<DVec3>,
    bands: Vec<Vec<u32>>,
}

/// Number of pixel rows in a band.
const BAND_ROWS: u32 = 8;

/// The nearest triangle at each sample of a band, row by row.
///
/// Each pixel has `samples` × `samples` samples.
pub(super) struct Hits {
    pub(super) triangles: Vec<u32>,
    /// Depth along the optical axis, in metres.
    pub(super) depths: Vec<f64>,
}

impl<'a> Raster<'a> {
    pub(super) fn new(model: &'a SceneMesh, camera: &Camera, camera_from_world: &Pose) -> Self {
        let x_in_camera: Vec<DVec3> = model
            .positions
            .par_iter()
            .map(|&x| camera_from_world.transform(x))
            .collect();
        let world_from_camera = camera_from_world.inverse();
        let bands = vec![Vec::new(); camera.height.div_ceil(BAND_ROWS) as usize];
        let mut raster = Self {
            model,
            camera: *camera,
            world_from_camera,
            x_in_camera,
            bands,
        };
        for triangle in 0..model.triangles.len() as u32 {
            if let Some(facet) = raster.facet(triangle) {
                let limit = f64::from(camera.height) - 1.0;
                let band = |y: f64| (y.clamp(0.0, limit) / f64::from(BAND_ROWS)) as usize;
                if facet.high.y >= 0.0 && facet.low.y <= limit + 1.0 {
                    (band(facet.low.y)..=band(facet.high.y))
                        .for_each(|b| raster.bands[b].push(triangle));
                }
            }
        }
        raster
    }

    pub(super) fn band_count(&self) -> usize {
        self.bands.len()
    }

    /// Returns a triangle in the view of the camera.
    ///
    /// Returns `None` if the triangle is behind the camera, edge-on, or to the side of the image.
    pub(super) fn facet(&self, triangle: u32) -> Option<Facet> {
        let corners = self
            .model
            .triangles
            .get(triangle as usize)?
            .map(|v| self.x_in_camera[v as usize]);
        let [a, b, c] = corners;
        let volume = a.dot(b.cross(c));
        let sign = volume.signum();
        if volume == 0.0 || corners.iter().all(|x| x.z < NEAR_M) {
            return None;
        }
        let size = DVec2::new(f64::from(self.camera.width), f64::from(self.camera.height));
        let (mut low, mut high) = (DVec2::ZERO, size);
        if corners.iter().all(|x| x.z >= NEAR_M) {
            let px = corners
                .map(|x| x.truncate() / x.z * self.camera.focal_px + self.camera.principal_px);
            (low, high) = (px[0].min(px[1]).min(px[2]), px[0].max(px[1]).max(px[2]));
        }
        let edges = [b.cross(c) * sign, c.cross(a) * sign, a.cross(b) * sign];
        (high.x >= 0.0 && low.x <= size.x).then_some(Facet {
            edges,
            volume: volume.abs(),
            low,
            high,
        })
    }

    /// Returns the triangles that touch a band.
    pub(super) fn facets(&self, band: usize) -> impl Iterator<Item = Facet> + '_ {
        self.bands[band]
            .iter()
            .filter_map(|&triangle| self.facet(triangle))
    }

    /// Rasterizes a band with `samples` × `samples` evenly spread samples per pixel.
    ///
    /// If `samples` is odd, one of them is at the pixel centre.
    pub(super) fn hits(&self, band: usize, samples: u32) -> Hits {
        let rows = band_rows(&self.camera, band);
        let columns = (self.camera.width * samples) as usize;
        let (first, count) = (rows.start * samples, (rows.len() as u32 * samples) as usize);
        let mut hits = Hits {
            triangles: vec![NOTHING; columns * count],
            depths: vec![f64::MAX; columns * count],
        };
        let scale = f64::from(samples);
        for &triangle in &self.bands[band] {
            let Some(facet) = self.facet(triangle) else {
                continue;
            };
            let span = |low: f64, high: f64, first: u32, limit: usize| {
                let from = (low * scale - 0.5).ceil().max(f64::from(first)) - f64::from(first);
                let to = (high * scale - 0.5).floor() - f64::from(first) + 1.0;
                from as usize..(to.max(0.0) as usize).min(limit)
            };
            for row in span(facet.low.y, facet.high.y, first, count) {
                for column in span(facet.low.x, facet.high.x, 0, columns) {
                    let ray = self.ray(column as u32, first + row as u32, samples);
                    let at = row * columns + column;
                    if let Some(depth) = facet.depth(ray).filter(|&depth| depth < hits.depths[at]) {
                        hits.triangles[at] = triangle;
                        hits.depths[at] = depth;
                    }
                }
            }
        }
        hits
    }

    /// Returns the direction (z = 1) through a sample in camera space.
    pub(super) fn ray(&self, column: u32, row: u32, samples: u32) -> DVec3 {
        let at_px = DVec2::new(f64::from(column) + 0.5, f64::from(row) + 0.5) / f64::from(samples);
        self.camera.unproject(at_px).extend(1.0)
    }
}

impl Facet {
    /// Returns the pixels that the triangle may touch, limited to the given ranges.
    pub(super) fn pixels(&self, columns: Range<u32>, rows: Range<u32>) -> (Range<u32>, Range<u32>) {
        let cut = |low: f64, high: f64, within: Range<u32>| {
            let low = low.clamp(f64::from(within.start), f64::from(within.end)) as u32;
            let high =
                (high.floor() + 1.0).clamp(f64::from(within.start), f64::from(within.end)) as u32;
            low..high
        };
        (
            cut(self.low.x, self.high.x, columns),
            cut(self.low.y, self.high.y, rows),
        )
    }

    /// Returns the depth along the optical axis where a ray (z = 1) hits; `None` if it misses.
    #[inline]
    pub(super) fn depth(&self, ray: DVec3) -> Option<f64> {
        let [a, b, c] = self.edges.map(|edge| edge.dot(ray));
        if a < 0.0 || b < 0.0 || c < 0.0 {
            return None;
        }
        Some(self.volume / (a + b + c)).filter(|&depth| depth >= NEAR_M && depth.is_finite())
    }

    /// Returns the barycentric coordinates (sum 1) where a ray hits.
    #[inline]
    pub(super) fn shares(&self, ray: DVec3) -> [f64; 3] {
        let weights = self.edges.map(|edge| edge.dot(ray));
        let sum: f64 = weights.iter().sum();
        weights.map(|w| w / sum)
    }
}

/// Returns the image rows of a band.
pub(super) fn band_rows(camera: &Camera, band: usize) -> Range<u32> {
    let first = band as u32 * BAND_ROWS;
    first..(first + BAND_ROWS).min(camera.height)
}

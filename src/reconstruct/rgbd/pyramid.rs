use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::rgbd_image::{RgbdImage, SAME_SURFACE};
use ostra_core::image::{halve, lerp, mean_of_four};
use ostra_geometry::{Pinhole, is_same_depth};

/// Number of levels, each half as large as the one before.
pub const LEVELS: usize = 4;

/// A view at several sizes, largest first, prepared for alignment.
#[derive(Debug, Clone)]
pub struct Pyramid {
    /// The levels.
    pub levels: Vec<PyramidLevel>,
    /// Mean of the known depths, in world units; 0 without any.
    pub typical_depth: f32,
}

/// One size of a view; pixels row by row.
#[derive(Debug, Clone)]
pub struct PyramidLevel {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Focal lengths in pixels.
    pub focal: Vec2,
    /// Principal point in pixels; the centre of the top-left pixel is at (0.5, 0.5).
    pub principal: Vec2,
    /// Luma, 0–1.
    pub grey: Vec<f32>,
    /// Depth in world units, 0 = unknown.
    pub depths: Vec<f32>,
    /// Unit normals towards the camera, in its axes; zero where unknown.
    pub normals: Vec<Vec3>,
}

impl Pyramid {
    /// Computes all levels of a view.
    #[must_use]
    pub fn new(view: &RgbdImage) -> Self {
        let pixels = view.grey.len();
        let mut level = PyramidLevel {
            width: view.camera.width as usize,
            height: view.camera.height as usize,
            focal: view.camera.focal_px.as_vec2(),
            principal: view.camera.principal_px.as_vec2(),
            grey: view
                .grey
                .iter()
                .map(|&grey| f32::from(grey) / 255.0)
                .collect(),
            depths: (0..pixels).map(|pixel| view.depth(pixel)).collect(),
            normals: Vec::new(),
        };
        let mut levels = Vec::with_capacity(LEVELS);
        while levels.len() + 1 < LEVELS {
            let next = level.halved();
            levels.push(level.with_normals());
            level = next;
        }
        levels.push(level.with_normals());
        let coarsest = &levels[LEVELS - 1].depths;
        let known = coarsest.iter().filter(|&&depth| depth > 0.0);
        let typical_depth = known.clone().sum::<f32>() / known.count().max(1) as f32;
        Self {
            levels,
            typical_depth,
        }
    }
}

impl PyramidLevel {
    /// Returns the ray of a pixel: its point at depth 1.
    #[must_use]
    pub fn ray(&self, x: usize, y: usize) -> Vec3 {
        ((Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - self.principal) / self.focal).extend(1.0)
    }

    /// Projects a point in the camera's axes to pixels; `None` outside the image.
    #[must_use]
    pub fn project(&self, point: Vec3) -> Option<Vec2> {
        let camera = Pinhole {
            focal: self.focal,
            principal: self.principal,
            size: Vec2::new(self.width as f32, self.height as f32),
        };
        camera.project_inside(point)
    }

    /// Returns luma at a position in pixels and its slope per pixel; `None` within half a pixel of the border.
    #[must_use]
    pub fn grey_at(&self, at_px: Vec2) -> Option<(f32, Vec2)> {
        let at = at_px - 0.5;
        if at.x < 0.0 || at.y < 0.0 {
            return None;
        }
        let (x, y) = (at.x as usize, at.y as usize);
        if x + 1 >= self.width || y + 1 >= self.height {
            return None;
        }
        let share = at.fract();
        let row = y * self.width + x;
        let [a, b, c, d] =
            [row, row + 1, row + self.width, row + self.width + 1].map(|pixel| self.grey[pixel]);
        let (above, below) = (lerp(a, b, share.x), lerp(c, d, share.x));
        let across = (b - a) + share.y * ((d - c) - (b - a));
        Some((
            lerp(above, below, share.y),
            Vec2::new(across, below - above),
        ))
    }

    /// Halves the size: means of 2 × 2 pixels; of depths only those on the nearest surface.
    fn halved(&self) -> Self {
        let (width, height) = ((self.width / 2).max(1), (self.height / 2).max(1));
        Self {
            width,
            height,
            focal: self.focal
                * Vec2::new(
                    width as f32 / self.width as f32,
                    height as f32 / self.height as f32,
                ),
            principal: self.principal
                * Vec2::new(
                    width as f32 / self.width as f32,
                    height as f32 / self.height as f32,
                ),
            grey: halve(&self.grey, self.width, self.height, mean_of_four),
            depths: halve(&self.depths, self.width, self.height, mean_depth),
            normals: Vec::new(),
        }
    }

    fn with_normals(mut self) -> Self {
        let (width, height) = (self.width, self.height);
        let normal = |pixel: usize| {
            let (x, y) = (pixel % width, pixel / width);
            if x == 0 || y == 0 || x + 1 == width || y + 1 == height {
                return Vec3::ZERO;
            }
            let own = self.depths[pixel];
            let point = |x: usize, y: usize| {
                let depth = self.depths[y * width + x];
                (depth > 0.0 && is_same_depth(depth, own, SAME_SURFACE))
                    .then(|| self.ray(x, y) * depth)
            };
            let (left, right, above, below) = (
                point(x - 1, y),
                point(x + 1, y),
                point(x, y - 1),
                point(x, y + 1),
            );
            let (Some(left), Some(right), Some(above), Some(below)) = (left, right, above, below)
            else {
                return Vec3::ZERO;
            };
            // Down × right points to the camera, whose z axis points away from it.
            (below - above).cross(right - left).normalize_or_zero()
        };
        self.normals = (0..width * height).into_par_iter().map(normal).collect();
        self
    }
}

/// Returns the mean of the depths on the nearest surface; 0 without any.
fn mean_depth(depths: [f32; 4]) -> f32 {
    let nearest = depths
        .iter()
        .copied()
        .filter(|&depth| depth > 0.0)
        .fold(f32::INFINITY, f32::min);
    let (mut sum, mut count) = (0.0, 0.0);
    for depth in depths {
        if depth > 0.0 && depth < nearest * (1.0 + SAME_SURFACE) {
            sum += depth;
            count += 1.0;
        }
    }
    if count > 0.0 { sum / count } else { 0.0 }
}

//! Images as PatchMatch reads them: tones, textures, and their pyramids.

use std::sync::Arc;

use glam::{DMat3, DVec3};

use super::plane::{Raster, Transfer};
use ostra_core::image::{bilinear, halve, mean_of_four};
use ostra_geometry::{Camera, Pose};

/// An image prepared for comparison, row by row.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Tones {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width · height` greys, 0–255.
    pub luma: Vec<f32>,
    /// `width · height` chroma values (blue, red), −128–127; empty = grey throughout.
    pub chroma: Vec<[f32; 2]>,
}

impl Tones {
    /// Returns the image at half the size, each pixel the mean of four; an odd last row or column is dropped.
    pub fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let luma = halve(&self.luma, self.width, self.height, mean_of_four);
        let mixed = |four: [[f32; 2]; 4]| {
            std::array::from_fn(|channel| mean_of_four(four.map(|pixel| pixel[channel])))
        };
        let chroma = if self.chroma.is_empty() {
            Vec::new()
        } else {
            halve(&self.chroma, self.width, self.height, mixed)
        };
        Self {
            width,
            height,
            luma,
            chroma,
        }
    }

    /// Returns whether no two pixels differ by more than rounding.
    pub fn is_constant(&self) -> bool {
        let (low, high) = self
            .luma
            .iter()
            .fold((f32::MAX, f32::MIN), |(l, h), &v| (l.min(v), h.max(v)));
        self.luma.is_empty() || high - low < 2.0
    }
}

/// Adding and subtracting this rounds a float between −2²² and 2²² to an integer.
///
/// After the addition, the bits are those of this number plus the integer.
pub const ROUNDING: f32 = 12_582_912.0;

/// Splits a position, 0 or more, into the pixel below and the share of the way to the next.
///
/// If the position is that of a pixel, it may be either one.
#[inline(always)]
fn split(at: f32) -> (usize, f32) {
    let counted = at - 0.5 + ROUNDING;
    (
        counted.to_bits().wrapping_sub(ROUNDING.to_bits()) as usize,
        at - (counted - ROUNDING),
    )
}

/// An image prepared for bilinear sampling: each element holds four neighbouring greys, so that a sample is one load.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Texture {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Greys 0–255 of (x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1), from the lowest byte on.
    pub quads: Vec<u32>,
    /// Chroma (blue, red) of each pixel, 128 = grey.
    pub chroma: Vec<[u8; 2]>,
}

impl Texture {
    /// Converts an image, rounded to 8 bits.
    pub fn new(tones: &Tones) -> Self {
        let (width, height) = (tones.width, tones.height);
        let bytes: Vec<u8> = tones
            .luma
            .iter()
            .map(|&value| (value + 0.5) as u8)
            .collect();
        let mut quads = Vec::with_capacity(bytes.len());
        for y in 0..height {
            let rows = [y * width, (y + 1).min(height - 1) * width];
            for x in 0..width {
                let next = (x + 1).min(width - 1);
                let quad = [
                    bytes[rows[0] + x],
                    bytes[rows[0] + next],
                    bytes[rows[1] + x],
                    bytes[rows[1] + next],
                ];
                quads.push(u32::from_le_bytes(quad));
            }
        }
        let biased = |chroma: &[f32; 2]| chroma.map(|value| (value + 128.5) as u8);
        let mut chroma: Vec<[u8; 2]> = tones.chroma.iter().map(biased).collect();
        chroma.resize(quads.len(), [128; 2]);
        Self {
            width,
            height,
            quads,
            chroma,
        }
    }

    /// Returns the index of the last column.
    #[inline(always)]
    pub fn last_column(&self) -> f32 {
        // Processors convert signed 32 bits.
        (self.width as i32 - 1) as f32
    }

    /// Returns the index of the last row.
    #[inline(always)]
    pub fn last_row(&self) -> f32 {
        (self.height as i32 - 1) as f32
    }

    /// Returns the grey of a pixel.
    #[inline(always)]
    pub fn grey(&self, x: usize, y: usize) -> u8 {
        self.quads[y * self.width + x] as u8
    }

    /// Returns the squared difference of colour between a pixel and one of another image, in grey levels.
    ///
    /// Chroma has the same weight as in the weights of a patch.
    pub fn color_difference(&self, at: usize, other: &Self, there: usize) -> f32 {
        let grey = f32::from(self.quads[at] as u8) - f32::from(other.quads[there] as u8);
        let (p, q) = (self.chroma[at], other.chroma[there]);
        let chroma = |k: usize| f32::from(p[k].abs_diff(q[k])).powi(2);
        grey * grey + 3.0 * (chroma(0) + chroma(1))
    }

    /// Returns the chroma at a position within the image, interpolated between four pixels.
    #[inline(always)]
    pub fn chroma_at(&self, u: f32, v: f32) -> [f32; 2] {
        let ((left, share_x), (top, share_y)) = (split(u), split(v));
        let (left, top) = (left.min(self.width - 1), top.min(self.height - 1));
        let (right, bottom) = (
            (left + 1).min(self.width - 1),
            (top + 1).min(self.height - 1),
        );
        let corner = |x: usize, y: usize| self.chroma[y * self.width + x].map(f32::from);
        let (a, b, c, d) = (
            corner(left, top),
            corner(right, top),
            corner(left, bottom),
            corner(right, bottom),
        );
        std::array::from_fn(|k| bilinear([a[k], b[k], c[k], d[k]], [share_x, share_y]))
    }
}

/// A posed pinhole image with its pyramid, each level half the size of the one before.
#[derive(Debug, Clone, PartialEq)]
pub struct PosedImage {
    /// Intrinsics of the finest level, without distortion.
    pub camera: Camera,
    /// Pose of the image.
    pub camera_from_world: Pose,
    /// Levels of the pyramid from the finest on; at least one.
    pub levels: Vec<Arc<Texture>>,
    /// Whether no two pixels differ, so that nothing can be compared.
    pub is_constant: bool,
}

impl PosedImage {
    /// Builds the pyramid of an image, down to a longer side of at least `coarsest_px`.
    #[must_use]
    pub fn new(tones: Tones, camera: Camera, camera_from_world: Pose, coarsest_px: u32) -> Self {
        let is_constant = tones.is_constant();
        let mut levels = vec![Arc::new(Texture::new(&tones))];
        let mut finest = tones;
        while finest.width.max(finest.height) / 2 >= coarsest_px.max(32) as usize
            && finest.width.min(finest.height) > 1
        {
            finest = finest.halved();
            levels.push(Arc::new(Texture::new(&finest)));
        }
        Self {
            camera,
            camera_from_world,
            levels,
            is_constant,
        }
    }

    /// Returns the size of its pixels in bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        let texel = size_of::<u32>() + size_of::<[u8; 2]>();
        self.levels
            .iter()
            .map(|level| level.quads.len() * texel)
            .sum()
    }

    /// Returns columns and rows of the finest level.
    #[must_use]
    pub fn size(&self) -> (usize, usize) {
        (self.levels[0].width, self.levels[0].height)
    }

    /// Returns the camera at a level.
    #[must_use]
    pub fn raster(&self, level: usize) -> Raster {
        let (focal, principal) = self.at_level(level);
        Raster {
            focal: focal.map(|v| v as f32),
            principal: principal.map(|v| v as f32),
        }
    }

    /// Returns focal lengths and principal point in pixel indices of a level.
    fn at_level(&self, level: usize) -> ([f64; 2], [f64; 2]) {
        let mut focal = self.camera.focal_px.to_array();
        let mut principal = (self.camera.principal_px - 0.5).to_array();
        for _ in 0..level {
            focal = focal.map(|f| 0.5 * f);
            // The centre of a coarse pixel lies between those of its two fine ones.
            principal = principal.map(|c| 0.5 * (c - 0.5));
        }
        (focal, principal)
    }

    fn matrix(&self, level: usize) -> DMat3 {
        let ([fx, fy], [cx, cy]) = self.at_level(level);
        DMat3::from_cols(
            DVec3::new(fx, 0.0, 0.0),
            DVec3::new(0.0, fy, 0.0),
            DVec3::new(cx, cy, 1.0),
        )
    }

    /// Returns the transfer from this image's pixels to another's, both at a level.
    #[must_use]
    pub fn transfer(&self, to: &Self, level: usize) -> Transfer {
        let to_from_here = to
            .camera_from_world
            .compose(&self.camera_from_world.inverse());
        let k = to.matrix(level);
        let matrix = k * DMat3::from_quat(to_from_here.rotation) * self.matrix(level).inverse();
        let column = |v: DVec3| v.as_vec3().to_array();
        Transfer {
            matrix: [
                column(matrix.x_axis),
                column(matrix.y_axis),
                column(matrix.z_axis),
            ],
            offset: column(k * to_from_here.translation),
        }
    }
}

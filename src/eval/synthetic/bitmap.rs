use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::noise::fractal_noise;

/// A picture on a surface, 1 texel a millimetre, linear RGB.
#[derive(Debug, Clone)]
pub(super) struct Bitmap {
    pub(super) width: usize,
    pub(super) height: usize,
    texels: Vec<[u8; 3]>,
}

impl Bitmap {
    pub(super) const TEXELS_PER_M: f32 = 1000.0;

    /// A picture of `size_m` metres filled by `color(at_mm)` with sRGB values of 0–1.
    pub(super) fn painted(size_m: Vec2, color: impl Fn(Vec2) -> Vec3 + Sync) -> Self {
        let size = (size_m * Self::TEXELS_PER_M).ceil().max(Vec2::ONE);
        let (width, height) = (size.x as usize, size.y as usize);
        let texels = (0..width * height)
            .into_par_iter()
            .map(|k| {
                stored(color(Vec2::new(
                    (k % width) as f32 + 0.5,
                    (k / width) as f32 + 0.5,
                )))
            })
            .collect();
        Self {
            width,
            height,
            texels,
        }
    }

    /// Repaints the texels inside a box (corners in texels, clipped): `color(at, before)`, sRGB of 0–1.
    pub(super) fn paint(
        &mut self,
        low: Vec2,
        high: Vec2,
        color: impl Fn(Vec2, Vec3) -> Vec3 + Sync,
    ) {
        let clip = |v: f32, limit: usize| v.clamp(0.0, limit as f32) as usize;
        let (top, bottom) = (clip(low.y, self.height), clip(high.y.ceil(), self.height));
        let (left, right) = (clip(low.x, self.width), clip(high.x.ceil(), self.width));
        if left >= right || top >= bottom {
            return;
        }
        let rows = &mut self.texels[top * self.width..bottom * self.width];
        rows.par_chunks_mut(self.width)
            .enumerate()
            .for_each(|(row, texels)| {
                for (column, texel) in texels[left..right].iter_mut().enumerate() {
                    let before = Vec3::from(texel.map(|v| f32::from(v) / 255.0));
                    let at = Vec2::new((left + column) as f32 + 0.5, (top + row) as f32 + 0.5);
                    *texel = stored(color(at, before));
                }
            });
    }

    /// A fine grain over all texels, so that no place is without texture.
    pub(super) fn roughen(&mut self, amount: f32, seed: u32) {
        let size = Vec2::new(self.width as f32, self.height as f32);
        self.paint(Vec2::ZERO, size, |at, before| {
            before * (1.0 + amount * fractal_noise(at * 0.3, 3, seed))
        });
    }

    /// The colour at `at_m`, bilinear between texel centres and clamped to the border, linear RGB.
    pub(super) fn sample(&self, at_m: Vec2) -> Vec3 {
        let limit = Vec2::new((self.width - 1) as f32, (self.height - 1) as f32);
        let at = (at_m * Self::TEXELS_PER_M - 0.5).clamp(Vec2::ZERO, limit);
        let (x, y) = (at.x as usize, at.y as usize);
        let (right, below) = ((x + 1).min(self.width - 1), (y + 1).min(self.height - 1));
        let f = at.fract();
        let texel = |x: usize, y: usize| decoded(self.texels[y * self.width + x]);
        let top = texel(x, y).lerp(texel(right, y), f.x);
        top.lerp(texel(x, below).lerp(texel(right, below), f.x), f.y)
    }
}

/// sRGB of 0–1 to linear, by the square that lies within 0.03 of the exact curve.
pub(super) fn linear(srgb: Vec3) -> Vec3 {
    srgb * srgb
}

/// Linear RGB to sRGB bytes, the inverse of [`linear`].
pub(super) fn encoded(linear: Vec3) -> [u8; 3] {
    stored(linear.max(Vec3::ZERO).map(f32::sqrt))
}

fn stored(srgb: Vec3) -> [u8; 3] {
    (srgb.clamp(Vec3::ZERO, Vec3::ONE) * 255.0 + 0.5)
        .to_array()
        .map(|v| v as u8)
}

fn decoded(texel: [u8; 3]) -> Vec3 {
    linear(Vec3::from(texel.map(f32::from)) / 255.0)
}

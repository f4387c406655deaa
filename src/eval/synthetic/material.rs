use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::noise::{fractal_noise, value_noise};

/// Material of a part.
#[derive(Debug, Clone)]
pub(super) enum Material {
    /// An image, one of the scene's bitmaps.
    Image {
        bitmap: usize,
    },
    /// A leaf blade that is yellow towards its tip.
    Blade {
        length_m: f32,
    },
    /// A leaf sheath.
    Sheath,
    /// A culm with rings at its nodes (arc lengths in metres).
    Culm {
        nodes_m: Vec<f32>,
    },
    Rachis,
    Grain,
    Clay,
    Soil,
    Wood,
    /// Moulded plastic of one colour (sRGB).
    Plastic {
        color: Vec3,
    },
    Rubber,
}

impl Material {
    /// Returns the linear RGB reflectance at the texture position `uv` (metres).
    pub(super) fn albedo(&self, uv: Vec2, seed: u32, bitmaps: &[Bitmap]) -> Vec3 {
        let mm = uv * 1000.0;
        match self {
            Self::Image { bitmap } => bitmaps
                .get(*bitmap)
                .map_or(Vec3::ZERO, |bitmap| bitmap.sample(uv)),
            Self::Blade { length_m } => linear(blade(mm, uv.y / length_m, seed)),
            Self::Sheath => linear(fibrous(Vec3::new(0.45, 0.57, 0.25), mm, 1.4, seed)),
            Self::Culm { nodes_m } => linear(culm(mm, nodes_m, seed)),
            Self::Rachis => {
                linear(Vec3::new(0.60, 0.62, 0.30) * (1.0 + 0.15 * value_noise(mm, seed)))
            }
            Self::Grain => linear(grain(mm, seed)),
            Self::Clay => linear(
                Vec3::new(0.66, 0.40, 0.28) * (1.0 + 0.22 * fractal_noise(mm / 9.0, 5, seed)),
            ),
            Self::Soil => {
                linear(Vec3::new(0.27, 0.20, 0.15) * (1.0 + 0.7 * fractal_noise(mm / 5.0, 4, seed)))
            }
            Self::Wood => linear(wood(mm, seed)),
            Self::Plastic { color } => linear(plastic(*color, mm, seed)),
            Self::Rubber => {
                linear(Vec3::splat(0.17) * (1.0 + 0.10 * fractal_noise(mm / 3.0, 3, seed)))
            }
        }
    }

    /// Returns the strength of the highlight, 0–1.
    pub(super) fn gloss(&self) -> f32 {
        match self {
            Self::Blade { .. } | Self::Sheath | Self::Culm { .. } => 0.06,
            Self::Plastic { .. } => 0.08,
            _ => 0.0,
        }
    }

    /// Returns the share of the light on the far side that passes through.
    pub(super) fn translucency(&self) -> f32 {
        if matches!(self, Self::Blade { .. }) {
            0.45
        } else {
            0.0
        }
    }
}

/// Returns a number in −1…1 that varies between parts.
fn own(seed: u32) -> f32 {
    value_noise(Vec2::new(0.0, 0.0), seed ^ 0xa5a5)
}

fn blade(mm: Vec2, along: f32, seed: u32) -> Vec3 {
    let green = Vec3::new(0.40, 0.55, 0.22) * (1.0 + 0.06 * own(seed));
    let vein = (std::f32::consts::TAU * mm.x / 1.7).cos();
    let midrib = (-(mm.x / 0.7).powi(2)).exp();
    let mottle = fractal_noise(Vec2::new(mm.x / 3.0, mm.y / 16.0), 4, seed);
    let lit = green * (1.0 + 0.10 * vein + 0.22 * mottle) + Vec3::new(0.10, 0.10, 0.06) * midrib;
    let dry = ((along - 0.86) / 0.14 + 0.5 * value_noise(mm / 6.0, seed ^ 1)).clamp(0.0, 1.0);
    let freckle = if fractal_noise(mm / 2.6, 3, seed ^ 2) > 0.50 {
        0.72
    } else {
        1.0
    };
    lit.lerp(Vec3::new(0.68, 0.60, 0.32), 0.75 * dry) * freckle
}

/// Returns the colour of plant tissue with fibres along it, `pitch_mm` apart.
fn fibrous(base: Vec3, mm: Vec2, pitch_mm: f32, seed: u32) -> Vec3 {
    let fibre = (std::f32::consts::TAU * mm.x / pitch_mm).cos();
    let mottle = fractal_noise(Vec2::new(mm.x / 2.0, mm.y / 11.0), 4, seed);
    base * (1.0 + 0.06 * own(seed)) * (1.0 + 0.07 * fibre + 0.24 * mottle)
}

fn culm(mm: Vec2, nodes_m: &[f32], seed: u32) -> Vec3 {
    let tissue = fibrous(Vec3::new(0.56, 0.60, 0.295), mm, 1.9, seed);
    let distance = nodes_m
        .iter()
        .map(|node| (mm.y - node * 1000.0).abs())
        .fold(f32::MAX, f32::min);
    let ring = (-(distance / 1.6).powi(2)).exp();
    let halo = (-((distance - 5.0) / 2.5).powi(2)).exp();
    (tissue + Vec3::new(0.06, 0.07, 0.04) * halo).lerp(Vec3::new(0.35, 0.33, 0.17), 0.8 * ring)
}

fn grain(mm: Vec2, seed: u32) -> Vec3 {
    let straw = Vec3::new(0.76, 0.66, 0.34) * (1.0 + 0.12 * own(seed));
    let unripe = 0.5 + 0.5 * own(seed ^ 77);
    let ridge = (std::f32::consts::TAU * mm.x / 1.57).cos();
    let husk = straw.lerp(Vec3::new(0.58, 0.62, 0.28), 0.5 * unripe);
    husk * (1.0 + 0.13 * ridge + 0.20 * fractal_noise(mm * Vec2::new(1.3, 0.5), 3, seed))
}

fn wood(mm: Vec2, seed: u32) -> Vec3 {
    let plank = (mm.y / 110.0).floor();
    let shift = 40.0 * own(seed ^ (plank as i32 as u32).wrapping_mul(0x9e37));
    let at = Vec2::new(mm.x / 60.0 + shift, mm.y / 7.0);
    let rings = (6.0 * fractal_noise(at * 0.5, 3, seed)).sin();
    let joint = if (mm.y / 110.0 - plank) < 0.025 {
        0.45
    } else {
        1.0
    };
    Vec3::new(0.55, 0.41, 0.27)
        * (1.0 + 0.12 * rings + 0.16 * fractal_noise(at, 4, seed ^ 5) + 0.002 * shift)
        * joint
}

/// Returns the colour of worn plastic with fine scratches and stains.
fn plastic(color: Vec3, mm: Vec2, seed: u32) -> Vec3 {
    let scratch = fractal_noise(Vec2::new(mm.x / 0.9, mm.y / 5.0), 3, seed);
    color
        * (1.0 + 0.04 * own(seed))
        * (1.0 + 0.07 * scratch + 0.06 * fractal_noise(mm / 6.0, 3, seed ^ 1))
}

/// An image on a surface: one texel per millimetre, linear RGB.
#[derive(Debug, Clone)]
pub(super) struct Bitmap {
    pub(super) width: usize,
    pub(super) height: usize,
    texels: Vec<[u8; 3]>,
}

impl Bitmap {
    pub(super) const TEXELS_PER_M: f32 = 1000.0;

    /// Creates a bitmap of `size_m` metres from `color(at_mm)`, sRGB values of 0–1.
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

    /// Repaints the texels inside a box with `color(at, before)`, sRGB values of 0–1.
    ///
    /// The corners of the box are in texels and are clipped to the bitmap.
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

    /// Adds fine noise to all texels, so that every part of the surface has texture.
    pub(super) fn roughen(&mut self, amount: f32, seed: u32) {
        let size = Vec2::new(self.width as f32, self.height as f32);
        self.paint(Vec2::ZERO, size, |at, before| {
            before * (1.0 + amount * fractal_noise(at * 0.3, 3, seed))
        });
    }

    /// Returns the linear RGB at `at_m`, bilinear between texel centres and clamped to the border.
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

/// Converts sRGB of 0–1 to linear by squaring, which is within 0.03 of the exact curve.
fn linear(srgb: Vec3) -> Vec3 {
    srgb * srgb
}

/// Converts linear RGB to sRGB bytes; the inverse of [`linear`].
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

use super::posed_image::Texture;

/// Taps of the window.
pub const TAPS: usize = 24;
/// Taps padded by ones without weight, to whole vectors of any width.
pub const PADDED: usize = 32;
/// Reach of the window in pixels: small, so that a thin part is not matched by the background behind it.
const REACH: usize = 2;
/// Columns and rows of the window.
const SIDE: usize = 2 * REACH + 1;
/// Grey difference of `exp(−½)` in the weights.
const GREY_SIGMA: f32 = 30.0;
/// The same for chroma. It separates a leaf from its background where both are equally bright.
const CHROMA_SIGMA: f32 = 17.3;
/// Cost of a completely different colour, for a patch without texture.
pub const COLOR_WEIGHT: f32 = 1.4;
/// Variance of grey at which colour counts half as much: texture is more informative and does not
/// change with the light.
pub const COLOR_VARIANCE: f32 = 200.0;
/// Variance of grey (0–255) that is attributed to noise.
pub const NOISE: f32 = 2.0;
/// Variance of grey below which a patch may be flat.
pub const FLAT_BELOW: f32 = 4.0;
/// Variance of grey beyond noise at which a patch is a quarter flat.
pub const FLAT_VARIANCE: f32 = 1.0;

/// The window and its weights by grey difference.
#[derive(Debug, Clone)]
pub struct SupportWindow {
    /// Offsets in pixels from the centre.
    pub dx: [f32; PADDED],
    /// Offsets in pixels from the centre.
    pub dy: [f32; PADDED],
    /// Weight by distance.
    pub near: [f32; PADDED],
    /// Weight by difference of grey.
    pub alike: [f32; 256],
    /// Weight by difference of either part of chroma.
    pub alike_chroma: [f32; 256],
}

/// One pixel's surroundings in the reference image, prepared for NCC with bilateral weights.
#[derive(Debug, Clone)]
pub struct Patch {
    /// Bilateral weights; their sum is 1.
    pub weights: [f32; PADDED],
    /// Weight times the grey's difference from the weighted mean.
    pub weighted: [f32; PADDED],
    /// Weighted variance of grey.
    pub variance: f32,
    /// The pixel's chroma, 128 = grey.
    pub chroma: [f32; 2],
    /// Cost of a completely different colour.
    pub color_weight: f32,
    /// How much texture is missing, 0–1; 0 if the surrounding surface is unknown ([`Self::on`]).
    pub flatness: f32,
}

impl Default for SupportWindow {
    fn default() -> Self {
        let dx = std::array::from_fn(|tap| (place(tap) % SIDE) as f32 - REACH as f32);
        let dy = std::array::from_fn(|tap| (place(tap) / SIDE) as f32 - REACH as f32);
        let spread = 2.0 * (REACH * REACH) as f32;
        let near =
            std::array::from_fn(|tap| (-(dx[tap] * dx[tap] + dy[tap] * dy[tap]) / spread).exp());
        let alike =
            |sigma: f32| std::array::from_fn(|off| (-0.5 * (off as f32 / sigma).powi(2)).exp());
        Self {
            dx,
            dy,
            near,
            alike: alike(GREY_SIGMA),
            alike_chroma: alike(CHROMA_SIGMA),
        }
    }
}

/// Returns the position of a tap in the window, row by row; the centre is no tap.
#[inline(always)]
const fn place(tap: usize) -> usize {
    tap + tap / (TAPS / 2)
}

impl Patch {
    /// Creates the patch around a pixel; positions beyond the border take the border's grey.
    #[inline(always)]
    pub fn new(window: &SupportWindow, image: &Texture, x: usize, y: usize) -> Self {
        let (centre, own) = (image.grey(x, y), image.chroma[y * image.width + x]);
        let (mut values, mut weights) = ([0.0; TAPS], [0.0; PADDED]);
        let around = |at: usize, size: usize| -> [usize; SIDE] {
            std::array::from_fn(|k| (at + k).saturating_sub(REACH).min(size - 1))
        };
        let (columns, rows) = (
            around(x, image.width),
            around(y, image.height).map(|row| row * image.width),
        );
        for tap in 0..TAPS {
            let place = place(tap);
            let at = rows[place / SIDE] + columns[place % SIDE];
            let (grey, chroma) = (image.quads[at] as u8, image.chroma[at]);
            let [blue, red] =
                [0, 1].map(|k| window.alike_chroma[usize::from(chroma[k].abs_diff(own[k]))]);
            values[tap] = f32::from(grey);
            weights[tap] =
                window.near[tap] * window.alike[usize::from(grey.abs_diff(centre))] * (blue * red);
        }
        Self {
            chroma: own.map(f32::from),
            ..Self::weigh(&values, weights)
        }
    }

    /// Returns the same patch, on a surface known from the surroundings if `is_known`.
    ///
    /// Missing texture is then no evidence against the surface.
    #[inline(always)]
    pub fn on(self, is_known: bool) -> Self {
        let share = FLAT_VARIANCE * (1.0 / ((self.variance - NOISE).max(0.0) + FLAT_VARIANCE));
        let flatness = if is_known && self.variance < FLAT_BELOW {
            share * share
        } else {
            0.0
        };
        Self { flatness, ..self }
    }

    /// Returns whether there is nothing to compare.
    #[inline(always)]
    pub fn is_empty(&self, min_variance: f32) -> bool {
        self.variance < min_variance && self.flatness <= 0.0
    }

    #[inline(always)]
    fn weigh(values: &[f32; TAPS], mut weights: [f32; PADDED]) -> Self {
        let (mut sum, mut mean) = (0.0, 0.0);
        for tap in 0..TAPS {
            sum += weights[tap];
            mean += weights[tap] * values[tap];
        }
        let scale = 1.0 / sum;
        mean *= scale;
        let mut weighted = [0.0; PADDED];
        let mut variance = 0.0;
        for tap in 0..TAPS {
            weights[tap] *= scale;
            let off = values[tap] - mean;
            weighted[tap] = weights[tap] * off;
            variance += weighted[tap] * off;
        }
        let color_weight = COLOR_WEIGHT * COLOR_VARIANCE * (1.0 / (variance + COLOR_VARIANCE));
        Self {
            weights,
            weighted,
            variance,
            chroma: [0.0; 2],
            color_weight,
            flatness: 0.0,
        }
    }
}

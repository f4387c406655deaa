use super::texture::Texture;

/// Taps of the window.
pub const TAPS: usize = 24;
/// Taps made up with ones of no weight to whole vectors of any width.
pub const PADDED: usize = 32;
/// Sums of taps side by side, as graphics cards add them.
const LANES: usize = 4;
/// Reach of the window in pixels: small, so that a thin part is not compared by what lies behind it.
const REACH: usize = 2;
/// Pixels along each side of the window.
const SIDE: usize = 2 * REACH + 1;
/// Pixels of the window, the one in the middle among them, which is no tap.
const CELLS: usize = SIDE * SIDE;
/// The one in the middle.
const MIDDLE: usize = CELLS / 2;
/// Grey difference of `exp(−½)` in the weights.
const GREY_SIGMA: f32 = 30.0;
/// The same of colour, apart from grey: it tells a leaf from what lies behind it where both are equally bright.
const CHROMA_SIGMA: f32 = 17.3;
/// Cost of a colour that is wholly another, where a patch has no texture.
pub const COLOR_WEIGHT: f32 = 1.4;
/// Variance of grey at which colour counts half as much: texture tells more, and does not change with the light.
pub const COLOR_VARIANCE: f32 = 200.0;
/// Variance of grey (0–255) that is taken for noise.
pub const NOISE: f32 = 2.0;
/// Variance of grey below which a patch may be flat.
pub const FLAT_BELOW: f32 = 4.0;
/// Variance of grey beyond noise at which a patch is a quarter flat.
pub const FLAT_VARIANCE: f32 = 1.0;

/// The window and its weights by grey difference.
#[derive(Debug, Clone)]
pub struct Window {
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

/// One pixel's surroundings in the reference picture, made ready for NCC with bilateral weights.
#[derive(Debug, Clone)]
pub struct Patch {
    /// Bilateral weights; their sum is 1.
    pub weights: [f32; PADDED],
    /// Weight times the grey's difference from the weighted mean.
    pub weighted: [f32; PADDED],
    /// Weighted variance of grey.
    pub variance: f32,
    /// The pixel's colour apart from grey, 128 = grey.
    pub chroma: [f32; 2],
    /// Cost of a colour that is wholly another.
    pub color_weight: f32,
    /// How far texture is missing, 0–1; 0 where it is not known what surface lies around ([`Self::on`]).
    pub flatness: f32,
}

impl Default for Window {
    fn default() -> Self {
        let cell = |tap: usize| tap + tap / MIDDLE;
        let off = |at: usize| at as f32 - REACH as f32;
        let dx = std::array::from_fn(|tap| off(cell(tap) % SIDE));
        let dy = std::array::from_fn(|tap| off(cell(tap) / SIDE));
        let spread = 2.0 * (REACH * REACH) as f32;
        let near = std::array::from_fn(|tap| (-(dx[tap] * dx[tap] + dy[tap] * dy[tap]) / spread).exp());
        let alike = |sigma: f32| std::array::from_fn(|off| (-0.5 * (off as f32 / sigma).powi(2)).exp());
        Self { dx, dy, near, alike: alike(GREY_SIGMA), alike_chroma: alike(CHROMA_SIGMA) }
    }
}

impl Patch {
    /// The patch around a pixel; positions beyond the border take the border's grey.
    #[inline(always)]
    pub fn new(window: &Window, picture: &Texture, x: usize, y: usize) -> Self {
        let (centre, own) = (picture.grey(x, y), picture.chroma[y * picture.width + x]);
        let (greys, chromas) = cells(picture, x, y);
        let mut values = [0.0; TAPS];
        let mut weights = [0.0; PADDED];
        for (taps, cells) in [(0..MIDDLE, 0..MIDDLE), (MIDDLE..TAPS, MIDDLE + 1..CELLS)] {
            for (tap, cell) in taps.zip(cells) {
                let (grey, chroma) = (greys[cell], chromas[cell]);
                let [blue, red] = [0, 1].map(|k| window.alike_chroma[usize::from(chroma[k].abs_diff(own[k]))]);
                values[tap] = f32::from(grey);
                weights[tap] = window.near[tap] * window.alike[usize::from(grey.abs_diff(centre))] * (blue * red);
            }
        }
        Self { chroma: own.map(f32::from), ..Self::weigh(&values, weights) }
    }

    /// The same on a surface that is known from around where `is_known`: missing texture is then no reason for doubt.
    #[inline(always)]
    pub fn on(self, is_known: bool) -> Self {
        let share = FLAT_VARIANCE * (1.0 / ((self.variance - NOISE).max(0.0) + FLAT_VARIANCE));
        let flatness = if is_known && self.variance < FLAT_BELOW { share * share } else { 0.0 };
        Self { flatness, ..self }
    }

    /// Whether there is nothing to be compared.
    #[inline(always)]
    pub fn is_empty(&self, min_variance: f32) -> bool {
        self.variance < min_variance && self.flatness <= 0.0
    }

    #[inline(always)]
    fn weigh(values: &[f32; TAPS], mut weights: [f32; PADDED]) -> Self {
        let (mut sum, mut mean) = ([0.0; LANES], [0.0; LANES]);
        for tap in 0..TAPS {
            sum[tap % LANES] += weights[tap];
            mean[tap % LANES] += weights[tap] * values[tap];
        }
        let scale = 1.0 / total(sum);
        let mean = total(mean) * scale;
        let mut weighted = [0.0; PADDED];
        let mut variance = [0.0; LANES];
        for tap in 0..TAPS {
            weights[tap] *= scale;
            let off = values[tap] - mean;
            weighted[tap] = weights[tap] * off;
            variance[tap % LANES] += weighted[tap] * off;
        }
        let variance = total(variance);
        let color_weight = COLOR_WEIGHT * COLOR_VARIANCE * (1.0 / (variance + COLOR_VARIANCE));
        Self { weights, weighted, variance, chroma: [0.0; 2], color_weight, flatness: 0.0 }
    }
}

/// Greys and chromas of the window around a pixel, row by row, its own in the middle; beyond the border the border's.
#[inline(always)]
fn cells(picture: &Texture, x: usize, y: usize) -> ([u8; CELLS], [[u8; 2]; CELLS]) {
    let (width, height) = (picture.width, picture.height);
    let (mut greys, mut chromas) = ([0; CELLS], [[0; 2]; CELLS]);
    let is_far_in = x >= REACH && y >= REACH && x + REACH < width && y + REACH < height;
    for row in 0..SIDE {
        let line = (y + row).saturating_sub(REACH).min(height - 1) * width;
        let cells = row * SIDE..(row + 1) * SIDE;
        let (greys, chromas) = (&mut greys[cells.clone()], &mut chromas[cells]);
        if is_far_in {
            let first = line + x - REACH;
            let there = &picture.quads[first..first + SIDE];
            greys.iter_mut().zip(there).for_each(|(grey, quad)| *grey = *quad as u8);
            chromas.copy_from_slice(&picture.chroma[first..first + SIDE]);
        } else {
            for column in 0..SIDE {
                let at = line + (x + column).saturating_sub(REACH).min(width - 1);
                (greys[column], chromas[column]) = (picture.quads[at] as u8, picture.chroma[at]);
            }
        }
    }
    (greys, chromas)
}

#[inline(always)]
fn total([a, b, c, d]: [f32; LANES]) -> f32 {
    (a + b) + (c + d)
}

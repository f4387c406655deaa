use super::texture::Texture;

/// Taps of the window.
pub const TAPS: usize = 24;
/// Taps made up with ones of no weight to whole vectors of any width.
pub const PADDED: usize = 32;
/// Reach of the window in pixels: small, so that a thin part is not compared by what lies behind it.
const REACH: i32 = 2;
/// Grey difference of `exp(−½)` in the weights.
const GREY_SIGMA: f32 = 30.0;
/// Variance of grey (0–255) that is taken for noise.
pub const NOISE: f32 = 2.0;

/// The window and its weights by grey difference.
#[derive(Debug, Clone)]
pub struct Window {
    /// Offsets in pixels from the centre.
    pub dx: [f32; PADDED],
    /// Offsets in pixels from the centre.
    pub dy: [f32; PADDED],
    near: [f32; PADDED],
    alike: [f32; 256],
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
}

impl Default for Window {
    fn default() -> Self {
        let around = |tap: usize| (tap + tap / (TAPS / 2)) as i32;
        let side = 2 * REACH + 1;
        let dx = std::array::from_fn(|tap| (around(tap) % side - REACH) as f32);
        let dy = std::array::from_fn(|tap| (around(tap) / side - REACH) as f32);
        let spread = 2.0 * (REACH * REACH) as f32;
        let near = std::array::from_fn(|tap| (-(dx[tap] * dx[tap] + dy[tap] * dy[tap]) / spread).exp());
        let alike = std::array::from_fn(|grey| (-0.5 * (grey as f32 / GREY_SIGMA).powi(2)).exp());
        Self { dx, dy, near, alike }
    }
}

impl Patch {
    /// The patch around a pixel; positions beyond the border take the border's grey.
    #[inline(always)]
    pub fn new(window: &Window, picture: &Texture, x: usize, y: usize) -> Self {
        let centre = picture.grey(x, y);
        let mut values = [0.0; TAPS];
        let mut weights = [0.0; PADDED];
        for tap in 0..TAPS {
            let column = (x as f32 + window.dx[tap]).max(0.0) as usize;
            let row = (y as f32 + window.dy[tap]).max(0.0) as usize;
            let grey = picture.grey(column.min(picture.width - 1), row.min(picture.height - 1));
            values[tap] = f32::from(grey);
            weights[tap] = window.near[tap] * window.alike[usize::from(grey.abs_diff(centre))];
        }
        Self::weigh(&values, weights)
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
        Self { weights, weighted, variance }
    }
}

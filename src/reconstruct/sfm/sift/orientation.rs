//! Gradients, and the orientations of keypoints from them.

use std::f32::consts::TAU;

use pulp::{Arch, Simd, WithSimd};

use super::refine::Extremum;
use super::rows::Rows;

/// Maximum number of samples of a row that a keypoint's surroundings span.
const MOST_COLUMNS: usize = 256;

/// Gradients of a section of a row.
struct GradientRow {
    /// Length, in grey per sample.
    pub length: [f32; MOST_COLUMNS],
    /// Direction in turns, 0–1, from the x axis towards the y axis.
    pub turn: [f32; MOST_COLUMNS],
}

impl GradientRow {
    pub fn new() -> Self {
        Self {
            length: [0.0; MOST_COLUMNS],
            turn: [0.0; MOST_COLUMNS],
        }
    }

    /// Computes the central differences at columns `first..=last` of row `y`, all inside the image's border.
    #[inline(always)]
    pub fn fill(&mut self, level: &Rows, y: usize, first: usize, last: usize) {
        let [above, below] = [level.row(y - 1), level.row(y + 1)].map(|row| &row[first..=last]);
        let row = level.row(y);
        let (left, right) = (&row[first - 1..last], &row[first + 1..last + 2]);
        let out = self.length.iter_mut().zip(&mut self.turn);
        let across = right.iter().zip(left);
        let down = below.iter().zip(above);
        for ((length, turn), ((right, left), (below, above))) in out.zip(across.zip(down)) {
            let (dx, dy) = (0.5 * (right - left), 0.5 * (below - above));
            *length = (dx * dx + dy * dy).sqrt();
            *turn = turn_of(dx, dy);
        }
    }
}

/// Returns the direction of (dx, dy) in turns, 0–1, to 2e-6.
///
/// This is the polynomial of Abramowitz and Stegun, "Handbook of Mathematical Functions", 1964,
/// 4.4.47. It has no branches, so that it is vectorised.
#[inline(always)]
pub(super) fn turn_of(dx: f32, dy: f32) -> f32 {
    const COEFFICIENTS: [f32; 5] = [0.999_866, -0.330_299_5, 0.180_141, -0.085_133, 0.020_835_1];
    let (ax, ay) = (dx.abs(), dy.abs());
    let (small, large) = if ax < ay { (ax, ay) } else { (ay, ax) };
    let ratio = small / (large + f32::MIN_POSITIVE);
    let square = ratio * ratio;
    let [a, b, c, d, e] = COEFFICIENTS;
    let angle = ratio * (a + square * (b + square * (c + square * (d + square * e))));
    let turn = angle * (0.5 * std::f32::consts::FRAC_1_PI);
    let turn = if ax < ay { 0.25 - turn } else { turn };
    let turn = if dx < 0.0 { 0.5 - turn } else { turn };
    if dy < 0.0 { 1.0 - turn } else { turn }
}

const BINS: usize = 36;
/// Width of the Gaussian window over the gradients, in the keypoint's sigma.
const WINDOW: f32 = 1.5;
/// Passes of smoothing over the histogram.
const SMOOTHINGS: usize = 6;
/// Share of the highest peak that another one must reach.
const PEAK_SHARE: f32 = 0.8;

/// Returns the directions of the strongest gradients around a keypoint in radians, 0–2π, strongest first.
///
/// There are at most `most` (Lowe 2004, section 5). `sigma` is the keypoint's in samples of the
/// octave.
pub(super) fn orientations(level: &Rows, at: &Extremum, sigma: f32, most: usize) -> Vec<f32> {
    let mut histogram = Arch::new().dispatch(Histogram { level, at, sigma });
    (0..SMOOTHINGS).for_each(|_| histogram = smoothed(&histogram));
    let mut peaks = peaks(&histogram);
    peaks.sort_by(|a, b| b.1.total_cmp(&a.1));
    peaks
        .into_iter()
        .take(most)
        .map(|(angle, _)| angle)
        .collect()
}

struct Histogram<'a> {
    level: &'a Rows,
    at: &'a Extremum,
    sigma: f32,
}

impl WithSimd for Histogram<'_> {
    type Output = [f32; BINS];

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> [f32; BINS] {
        histogram(self.level, self.at, self.sigma)
    }
}

#[inline(always)]
fn histogram(level: &Rows, at: &Extremum, sigma: f32) -> [f32; BINS] {
    let window = WINDOW * sigma;
    let reach = (3.0 * window).floor().max(1.0);
    let (first, last) = span(at.x, reach, level.width);
    let (top, bottom) = span(at.y, reach, level.height);
    let weight = |distance: f32| (-0.5 * (distance / window).powi(2)).exp();
    let mut across = [0.0; MOST_COLUMNS];
    for (k, weight_x) in across.iter_mut().enumerate().take(last + 1 - first) {
        *weight_x = weight((first + k) as f32 - at.x);
    }
    let mut gradients = GradientRow::new();
    let mut bins = [0.0; BINS];
    for y in top..=bottom {
        let dy = y as f32 - at.y;
        let half = ((reach + 0.5).powi(2) - dy * dy).max(0.0).sqrt();
        let (from, to) = (
            ((at.x - half).ceil() as usize).max(first),
            ((at.x + half).floor() as usize).min(last),
        );
        if from > to {
            continue;
        }
        gradients.fill(level, y, from, to);
        let down = weight(dy);
        for k in 0..=to - from {
            let share = gradients.length[k] * across[from - first + k] * down;
            let place = gradients.turn[k] * BINS as f32 + (BINS as f32 - 0.5);
            let bin = place as usize;
            let upper = place - bin as f32;
            bins[bin % BINS] += (1.0 - upper) * share;
            bins[(bin + 1) % BINS] += upper * share;
        }
    }
    bins
}

/// Returns the samples within `reach` of `centre` that have neighbours on both sides.
#[inline(always)]
fn span(centre: f32, reach: f32, size: usize) -> (usize, usize) {
    let first = (centre - reach).ceil().max(1.0) as usize;
    let last = ((centre + reach).floor().max(1.0) as usize).min(size - 2);
    (first.min(last), last)
}

fn smoothed(bins: &[f32; BINS]) -> [f32; BINS] {
    std::array::from_fn(|k| (bins[(k + BINS - 1) % BINS] + bins[k] + bins[(k + 1) % BINS]) / 3.0)
}

/// Returns angle and height of each peak, fitted by a parabola.
fn peaks(bins: &[f32; BINS]) -> Vec<(f32, f32)> {
    let least = PEAK_SHARE * bins.iter().copied().fold(0.0, f32::max);
    let peak = |k: usize| {
        let (before, here, after) = (bins[(k + BINS - 1) % BINS], bins[k], bins[(k + 1) % BINS]);
        let is_peak = here > least && here > before && here > after;
        let offset = -0.5 * (after - before) / (after + before - 2.0 * here);
        is_peak.then(|| (TAU * (k as f32 + offset + 0.5) / BINS as f32, here))
    };
    (0..BINS).filter_map(peak).collect()
}

//! Gaussian kernels, and their use to blur, double and halve images.

use std::ops::Range;

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::rows::{MARGIN, PAD, Rows, extend_margins};

/// Reach of a Gaussian kernel in standard deviations: weights beyond are below a ten-thousandth.
const REACH: f32 = 4.0;

/// Weights of neighbouring samples; `taps[0]` belongs to the sample at offset `first`.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Kernel {
    /// Offset of the first tap in samples.
    pub first: isize,
    /// Weights, summing to 1.
    pub taps: Vec<f32>,
}

impl Kernel {
    /// Creates a Gaussian of standard deviation `sigma` samples.
    pub fn gaussian(sigma: f32) -> Self {
        let reach = (REACH * sigma).ceil().max(1.0) as isize;
        let weights: Vec<f32> = (-reach..=reach)
            .map(|k| (-0.5 * (k as f32 / sigma).powi(2)).exp())
            .collect();
        Self {
            first: -reach,
            taps: normalised(weights),
        }
    }

    /// Returns kernels for doubling by linear interpolation followed by a Gaussian of `sigma` doubled samples.
    ///
    /// The two kernels work on the original samples: one for the doubled samples at `2i`, one for
    /// those at `2i + 1`.
    pub fn doubling(sigma: f32) -> [Self; 2] {
        let fine = Self::gaussian(sigma);
        let reach = -fine.first + 1;
        let weight = |offset: isize| {
            let tap = |at: isize| {
                let known = usize::try_from(at - fine.first)
                    .ok()
                    .and_then(|k| fine.taps.get(k));
                known.copied().unwrap_or(0.0)
            };
            0.5 * tap(offset - 1) + tap(offset) + 0.5 * tap(offset + 1)
        };
        [0, 1].map(|phase| {
            let first = -(reach - phase) / 2;
            let last = (reach + phase) / 2;
            let weights = (first..=last).map(|k| weight(phase - 2 * k)).collect();
            Self {
                first,
                taps: normalised(weights),
            }
        })
    }
}

/// Variance that doubling by linear interpolation adds, in squared doubled samples.
pub(super) const DOUBLING_VARIANCE: f32 = 0.5;

fn normalised(weights: Vec<f32>) -> Vec<f32> {
    let sum: f32 = weights.iter().sum();
    weights.into_iter().map(|weight| weight / sum).collect()
}

/// Columns processed at a time: the rows that a kernel spans then fit the first-level cache.
const TILE: usize = 256;
/// Rows per parallel task.
const TASK_ROWS: usize = 16;
/// Maximum number of taps of a kernel.
const MAX_TAPS: usize = 2 * MARGIN + 1;

/// Writes rows `first..last` of `out`: `source` filtered with `kernel` in both directions.
pub(super) fn blur(source: &Rows, kernel: &Kernel, out: &mut Rows, first: usize, last: usize) {
    let (stride, width) = (out.stride(), out.width);
    out.piece_mut(first, last)
        .par_chunks_mut(TASK_ROWS * stride)
        .enumerate()
        .for_each(|(task, rows)| {
            let mut column_sums = [0.0; TILE + 2 * MARGIN + PAD];
            for tile in tiles(width) {
                let Tile { at, len } = tile;
                for (k, row) in rows.chunks_exact_mut(stride).enumerate() {
                    let y = first + task * TASK_ROWS + k;
                    let sums = sum_columns(source, y, kernel, tile.reach(kernel), &mut column_sums);
                    sum_shifted(sums, kernel, &mut row[MARGIN + at..MARGIN + at + len]);
                }
            }
            rows.chunks_exact_mut(stride)
                .for_each(|row| extend_margins(row, width));
        });
}

/// Writes rows `first..last` of `out`, which is twice as large as `source`.
///
/// The image is doubled and blurred by the kernels for its even and its odd samples.
pub(super) fn double(
    source: &Rows,
    kernels: &[Kernel; 2],
    out: &mut Rows,
    first: usize,
    last: usize,
) {
    let (stride, width) = (out.stride(), out.width);
    out.piece_mut(first, last)
        .par_chunks_mut(TASK_ROWS * stride)
        .enumerate()
        .for_each(|(task, rows)| {
            let mut column_sums = [0.0; TILE + 2 * MARGIN + PAD];
            let mut phases = [[0.0; TILE]; 2];
            for tile in tiles(source.width) {
                let Tile { at, len } = tile;
                for (k, row) in rows.chunks_exact_mut(stride).enumerate() {
                    let y = first + task * TASK_ROWS + k;
                    for (kernel, phase) in kernels.iter().zip(&mut phases) {
                        let sums = sum_columns(
                            source,
                            y / 2,
                            &kernels[y % 2],
                            tile.reach(kernel),
                            &mut column_sums,
                        );
                        sum_shifted(sums, kernel, &mut phase[..len]);
                    }
                    let pairs = row[MARGIN + 2 * at..]
                        .chunks_exact_mut(2)
                        .zip(phases[0].iter().zip(&phases[1]));
                    pairs
                        .take(len)
                        .for_each(|(pair, (&even, &odd))| pair.copy_from_slice(&[even, odd]));
                }
            }
            rows.chunks_exact_mut(stride)
                .for_each(|row| extend_margins(row, width));
        });
}

/// Returns `source` blurred, reduced to every other sample of every other row, starting with the first.
pub(super) fn halve(source: &Rows, kernel: &Kernel) -> Rows {
    let mut out = Rows::new(
        source.width.div_ceil(2),
        source.height.div_ceil(2),
        source.height,
    );
    let (stride, width, height) = (out.stride(), out.width, out.height);
    out.piece_mut(0, height)
        .par_chunks_mut(TASK_ROWS * stride)
        .enumerate()
        .for_each(|(task, rows)| {
            let mut column_sums = [0.0; TILE + 2 * MARGIN + PAD];
            let mut full = [0.0; TILE];
            for tile in tiles(source.width) {
                let Tile { at, len } = tile;
                for (k, row) in rows.chunks_exact_mut(stride).enumerate() {
                    let y = 2 * (task * TASK_ROWS + k);
                    let sums = sum_columns(source, y, kernel, tile.reach(kernel), &mut column_sums);
                    sum_shifted(sums, kernel, &mut full[..len]);
                    let kept = full[..len].iter().step_by(2);
                    row[MARGIN + at / 2..]
                        .iter_mut()
                        .zip(kept)
                        .for_each(|(out, &value)| *out = value);
                }
            }
            rows.chunks_exact_mut(stride)
                .for_each(|row| extend_margins(row, width));
        });
    out
}

/// Columns that are processed together.
#[derive(Clone, Copy)]
struct Tile {
    /// First column.
    at: usize,
    /// Number of columns, padded.
    len: usize,
}

impl Tile {
    /// Returns the columns, counted with the margin, that a kernel along the row reaches from the tile.
    fn reach(self, across: &Kernel) -> Range<usize> {
        let start = (MARGIN + self.at).saturating_add_signed(across.first);
        start..start + (self.len + across.taps.len()).next_multiple_of(PAD)
    }
}

/// Returns the tiles of an image.
fn tiles(width: usize) -> impl Iterator<Item = Tile> {
    (0..width).step_by(TILE).map(move |at| Tile {
        at,
        len: (width - at).min(TILE).next_multiple_of(PAD),
    })
}

/// Sums some columns of `source` down around row `y`.
fn sum_columns<'a>(
    source: &Rows,
    y: usize,
    down: &Kernel,
    columns: Range<usize>,
    out: &'a mut [f32],
) -> &'a [f32] {
    let mut rows: [&[f32]; MAX_TAPS] = [&[]; MAX_TAPS];
    let (len, count) = (columns.len(), down.taps.len());
    for (k, row) in rows[..count].iter_mut().enumerate() {
        *row = &source.nearest(y as isize + down.first + k as isize)[columns.clone()];
    }
    Arch::new().dispatch(WeightedSum {
        rows: &rows[..count],
        taps: &down.taps,
        out: &mut out[..len],
    });
    &out[..len]
}

/// Filters along the row: `out[x]` is the weighted sum of `row[x..]`.
fn sum_shifted(row: &[f32], across: &Kernel, out: &mut [f32]) {
    let mut rows: [&[f32]; MAX_TAPS] = [&[]; MAX_TAPS];
    let count = across.taps.len();
    for (k, shifted) in rows[..count].iter_mut().enumerate() {
        *shifted = &row[k..k + out.len()];
    }
    Arch::new().dispatch(WeightedSum {
        rows: &rows[..count],
        taps: &across.taps,
        out,
    });
}

/// The weighted sum of rows; lengths are multiples of [`PAD`].
struct WeightedSum<'a> {
    rows: &'a [&'a [f32]],
    taps: &'a [f32],
    out: &'a mut [f32],
}

/// Vectors summed in parallel, so that an addition need not wait for the one before.
const ABREAST: usize = 4;

impl WithSimd for WeightedSum<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let step = ABREAST * S::F32_LANES;
        for (k, out) in self.out.chunks_exact_mut(step).enumerate() {
            let mut sums = [simd.splat_f32s(0.0); ABREAST];
            for (row, &tap) in self.rows.iter().zip(self.taps) {
                let tap = simd.splat_f32s(tap);
                let (vectors, _) = S::as_simd_f32s(&row[k * step..(k + 1) * step]);
                for (sum, &vector) in sums.iter_mut().zip(vectors) {
                    *sum = simd.mul_add_e_f32s(vector, tap, *sum);
                }
            }
            S::as_mut_simd_f32s(out).0.copy_from_slice(&sums);
        }
    }
}

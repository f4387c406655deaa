//! Gaussian kernels, and their use to blur, double and halve images.

use std::ops::Range;

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::rows::{MARGIN, PAD, Rows, SpareBuffers, extend_margins};

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
const TASK_ROWS: usize = 8;
/// Maximum number of taps of a kernel.
const MAX_TAPS: usize = 2 * MARGIN + 1;

/// Writes rows `first..last` of `out`: `source` filtered with `kernel` in both directions.
pub(super) fn blur(source: &Rows, kernel: &Kernel, out: &mut Rows, first: usize, last: usize) {
    let down = GroupWeights::new([(0, kernel), (1, kernel), (2, kernel), (3, kernel)]);
    let columns = Columns {
        source,
        across: kernel,
        down,
    };
    columns.filter(
        out,
        first..last,
        |y| y,
        |sums, Tile { at, len }, row| {
            sum_shifted(sums, kernel, &mut row[at..at + len]);
        },
    );
}

/// Writes rows `first..last` of `out`, which is twice as large as `source`.
///
/// The image is doubled and blurred by the kernels for its even and its odd samples. `first` is
/// even.
pub(super) fn double(
    source: &Rows,
    kernels: &[Kernel; 2],
    out: &mut Rows,
    first: usize,
    last: usize,
) {
    let [even, odd] = kernels;
    let columns = Columns {
        source,
        across: even,
        down: GroupWeights::new([(0, even), (0, odd), (1, even), (1, odd)]),
    };
    let skipped = (odd.first - even.first) as usize;
    columns.filter(
        out,
        first..last,
        |y| y / 2,
        |sums, Tile { at, len }, row| {
            let mut phases = [[0.0; TILE]; 2];
            sum_shifted(sums, even, &mut phases[0][..len]);
            sum_shifted(&sums[skipped..], odd, &mut phases[1][..len]);
            let pairs = row[2 * at..].chunks_exact_mut(2);
            let values = phases[0].iter().zip(&phases[1]).take(len);
            for (pair, (&even, &odd)) in pairs.zip(values) {
                pair.copy_from_slice(&[even, odd]);
            }
        },
    );
}

/// Returns `source` blurred, reduced to every other sample of every other row, starting with the first.
pub(super) fn halve(source: &Rows, kernel: &Kernel, spare: &SpareBuffers) -> Rows {
    let size = [source.width, source.height].map(|side| side.div_ceil(2));
    let mut out = Rows::new(size[0], size[1], size[1], spare);
    let columns = Columns {
        source,
        across: kernel,
        down: GroupWeights::new([(0, kernel), (2, kernel), (4, kernel), (6, kernel)]),
    };
    columns.filter(
        &mut out,
        0..size[1],
        |y| 2 * y,
        |sums, Tile { at, len }, row| {
            let mut full = [0.0; TILE];
            sum_shifted(sums, kernel, &mut full[..len]);
            let kept = full[..len].iter().step_by(2);
            row[at / 2..]
                .iter_mut()
                .zip(kept)
                .for_each(|(out, &value)| *out = value);
        },
    );
    out
}

/// The columns of an image, to be summed down for groups of rows of another.
struct Columns<'a> {
    source: &'a Rows,
    /// Kernel for which the sums are needed along the row; of several, the one that begins first.
    across: &'a Kernel,
    down: GroupWeights,
}

impl Columns<'_> {
    /// Fills rows of `out`.
    ///
    /// `origin` returns the row of the source for the first row of a group. `finish` fills a tile of a
    /// row, given without its left margin, from the sums of columns that the kernel reaches.
    fn filter(
        &self,
        out: &mut Rows,
        rows: Range<usize>,
        origin: impl Fn(usize) -> usize + Sync,
        finish: impl Fn(&[f32], Tile, &mut [f32]) + Sync,
    ) {
        let (stride, width) = (out.stride(), out.width);
        let fill = |first: usize, rows: &mut [f32]| {
            let mut sums = [[0.0; TILE + 2 * MARGIN + PAD]; GROUP];
            for tile in tiles(self.source.width) {
                let reach = tile.reach(self.across);
                for (k, group) in rows.chunks_mut(GROUP * stride).enumerate() {
                    self.sum(origin(first + k * GROUP), reach.clone(), &mut sums);
                    for (sums, row) in sums.iter().zip(group.chunks_exact_mut(stride)) {
                        finish(&sums[..reach.len()], tile, &mut row[MARGIN..]);
                    }
                }
            }
            rows.chunks_exact_mut(stride)
                .for_each(|row| extend_margins(row, width));
        };
        out.piece_mut(rows.start, rows.end)
            .par_chunks_mut(TASK_ROWS * stride)
            .enumerate()
            .for_each(|(task, piece)| fill(rows.start + task * TASK_ROWS, piece));
    }

    /// Sums some columns for the group of rows from row `y` of the source on.
    fn sum(&self, y: usize, columns: Range<usize>, sums: &mut GroupSums) {
        let mut rows: [&[f32]; MAX_GROUP_ROWS] = [&[]; MAX_GROUP_ROWS];
        let (len, count) = (columns.len(), self.down.weights.len());
        let first = y as isize + self.down.first;
        for (k, row) in rows[..count].iter_mut().enumerate() {
            *row = &self.source.nearest(first + k as isize)[columns.clone()];
        }
        Arch::new().dispatch(GroupSum {
            rows: &rows[..count],
            weights: &self.down.weights,
            sums,
            len,
        });
    }
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

/// Rows whose column sums are computed together, so that each row of the source is loaded once for all.
const GROUP: usize = 4;
/// Maximum number of rows that a group spans.
const MAX_GROUP_ROWS: usize = MAX_TAPS + 2 * GROUP;

/// Weights of the rows of the source for each row of a group.
struct GroupWeights {
    /// Offset of the first row from the group's.
    first: isize,
    /// Weights by row of the source.
    weights: Vec<[f32; GROUP]>,
}

impl GroupWeights {
    /// Creates the weights of rows that lie at the offsets and have the kernels.
    fn new(rows: [(isize, &Kernel); GROUP]) -> Self {
        let begin = |&(offset, kernel): &(isize, &Kernel)| offset + kernel.first;
        let end = |row: &(isize, &Kernel)| begin(row) + row.1.taps.len() as isize;
        let first = rows.iter().map(begin).min().unwrap_or(0);
        let last = rows.iter().map(end).max().unwrap_or(0);
        let weight = |at: isize, row: &(isize, &Kernel)| {
            let tap = usize::try_from(at - begin(row)).ok();
            tap.and_then(|tap| row.1.taps.get(tap))
                .copied()
                .unwrap_or(0.0)
        };
        let weights = (first..last)
            .map(|at| std::array::from_fn(|k| weight(at, &rows[k])))
            .collect();
        Self { first, weights }
    }
}

/// Sums of columns of a tile for each row of a group.
type GroupSums = [[f32; TILE + 2 * MARGIN + PAD]; GROUP];

/// The weighted sums of rows for each row of a group; `len` is a multiple of [`PAD`].
struct GroupSum<'a> {
    rows: &'a [&'a [f32]],
    weights: &'a [[f32; GROUP]],
    sums: &'a mut GroupSums,
    len: usize,
}

/// Vectors of each row of a group that are summed in parallel.
const GROUP_ABREAST: usize = 2;

impl WithSimd for GroupSum<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        const { assert!(PAD.is_multiple_of(GROUP_ABREAST * S::F32_LANES)) };
        let step = GROUP_ABREAST * S::F32_LANES;
        for at in (0..self.len).step_by(step) {
            let mut sums = [[simd.splat_f32s(0.0); GROUP_ABREAST]; GROUP];
            for (row, weights) in self.rows.iter().zip(self.weights) {
                let (vectors, _) = S::as_simd_f32s(&row[at..at + step]);
                let vectors: [S::f32s; GROUP_ABREAST] = [vectors[0], vectors[1]];
                for (sums, &weight) in sums.iter_mut().zip(weights) {
                    let weight = simd.splat_f32s(weight);
                    for (sum, vector) in sums.iter_mut().zip(vectors) {
                        *sum = simd.mul_add_e_f32s(vector, weight, *sum);
                    }
                }
            }
            for (row, sums) in self.sums.iter_mut().zip(&sums) {
                S::as_mut_simd_f32s(&mut row[at..at + step])
                    .0
                    .copy_from_slice(sums);
            }
        }
    }
}

/// Filters along the row: `out[x]` is the weighted sum of `row[x..]`.
fn sum_shifted(row: &[f32], across: &Kernel, out: &mut [f32]) {
    Arch::new().dispatch(WeightedSum {
        row,
        taps: &across.taps,
        out,
    });
}

/// The weighted sum of a row's shifted copies; the length of `out` is a multiple of [`PAD`].
struct WeightedSum<'a> {
    row: &'a [f32],
    taps: &'a [f32],
    out: &'a mut [f32],
}

/// Vectors summed in parallel, so that an addition need not wait for the one before.
const ABREAST: usize = 8;

impl WithSimd for WeightedSum<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        const { assert!(PAD.is_multiple_of(ABREAST * S::F32_LANES)) };
        let Self { row, taps, out } = self;
        let step = ABREAST * S::F32_LANES;
        for (k, out) in out.chunks_exact_mut(step).enumerate() {
            let mut sums = [simd.splat_f32s(0.0); ABREAST];
            let row = &row[k * step..k * step + step + taps.len() - 1];
            for (shifted, &tap) in row.windows(step).zip(taps) {
                let tap = simd.splat_f32s(tap);
                let (vectors, _) = S::as_simd_f32s(shifted);
                for (sum, &vector) in sums.iter_mut().zip(vectors) {
                    *sum = simd.mul_add_e_f32s(vector, tap, *sum);
                }
            }
            S::as_mut_simd_f32s(out).0.copy_from_slice(&sums);
        }
    }
}

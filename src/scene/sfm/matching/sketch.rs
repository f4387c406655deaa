use nalgebra::{DMatrix, SymmetricEigen};

use super::lanes::{LANES, ROWS, tile};
use super::value::Value;

/// Values of a sketch.
pub(super) const SKETCH: usize = 48;
/// Principal directions in a sketch; the rest of it turns its dot products into bounds.
const DIRECTIONS: usize = SKETCH - 3;
/// Descriptors of each picture that the directions are found from.
const SAMPLE: usize = 2048;
/// Signs that descriptors are sorted by.
const KEY_BITS: usize = 7;
/// Added to bounds for what single precision rounds away.
const SLACK: f32 = 2e-5;
/// Keeps what only fills up a tile from ever reaching a bar.
const NEVER: f32 = -1e30;

/// Mean and principal directions of descriptors: few values hold most of what tells them apart.
#[derive(Debug, Clone)]
pub(super) struct Basis {
    mean: Vec<f32>,
    /// Directions as columns in panels of [`LANES`], each with one row per descriptor value.
    panels: Vec<Vec<[f32; LANES]>>,
}

/// One picture's descriptors, sorted such that those that are alike stand together, and drawn in to few values: the dot
/// product of one side's `rows` with another's `panels` is never below that of the descriptors themselves
/// (Cauchy–Schwarz on what the directions leave over).
#[derive(Debug, Clone)]
pub(super) struct Side<T> {
    /// Descriptor after descriptor.
    pub values: Vec<T>,
    /// Index of each in the picture.
    pub order: Vec<u32>,
    /// What they are sorted by: equal where the first directions have the same signs.
    pub keys: Vec<u32>,
    /// One sketch per descriptor, filled up to a multiple of [`ROWS`].
    pub rows: Vec<[f32; SKETCH]>,
    /// The same as columns, [`LANES`] of them to a panel.
    pub panels: Vec<[[f32; LANES]; SKETCH]>,
}

impl Basis {
    /// From samples of two pictures' descriptors with `dim` values each.
    pub fn fit<T: Value>(both: [&[T]; 2], dim: usize) -> Self {
        let sample: Vec<&[T]> = both
            .iter()
            .flat_map(|values| values.chunks_exact(dim).step_by((values.len() / dim).div_ceil(SAMPLE).max(1)))
            .collect();
        let all = DMatrix::from_fn(dim, sample.len(), |k, at| sample[at][k].unit());
        let mean = all.column_mean();
        let centred = DMatrix::from_fn(dim, sample.len(), |k, at| all[(k, at)] - mean[k]);
        let eigen = SymmetricEigen::new(&centred * centred.transpose());
        let mut order: Vec<usize> = (0..dim).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        order.truncate(DIRECTIONS);
        let value = |k: usize, at: usize| order.get(at).map_or(0.0, |&column| eigen.eigenvectors[(k, column)]);
        let panels = (0..SKETCH.div_ceil(LANES))
            .map(|panel| (0..dim).map(|k| std::array::from_fn(|lane| value(k, panel * LANES + lane))).collect())
            .collect();
        Self { mean: mean.as_slice().to_vec(), panels }
    }

    /// Values per descriptor.
    pub fn dim(&self) -> usize {
        self.mean.len()
    }

    /// All descriptors of a picture.
    #[inline(always)]
    pub fn side<const FUSED: bool, T: Value>(&self, unsorted: &[T]) -> Side<T> {
        let sketches = self.sketches::<FUSED, T>(unsorted);
        let key = |sketch: &[f32; SKETCH]| (0..KEY_BITS).fold(0, |key, at| 2 * key + u32::from(sketch[at] > 0.0));
        let mut order: Vec<(u32, u32)> = sketches.iter().map(key).zip(0..).take(unsorted.len() / self.dim()).collect();
        order.sort_unstable();
        let (keys, order): (Vec<u32>, Vec<u32>) = order.into_iter().unzip();
        let mut values = Vec::with_capacity(unsorted.len());
        let mut rows = Vec::with_capacity(sketches.len());
        for &at in &order {
            values.extend_from_slice(&unsorted[at as usize * self.dim()..(at as usize + 1) * self.dim()]);
            rows.push(sketches[at as usize]);
        }
        rows.extend_from_slice(&sketches[rows.len()..]);
        let panels = panels_of(&rows);
        Side { values, order, keys, rows, panels }
    }

    /// Sketches in the order of the descriptors, filled up to a multiple of [`ROWS`].
    #[inline(always)]
    fn sketches<const FUSED: bool, T: Value>(&self, values: &[T]) -> Vec<[f32; SKETCH]> {
        let mut rows = Vec::with_capacity((values.len() / self.dim()).next_multiple_of(ROWS));
        let mut centred = vec![0.0; ROWS * self.dim()];
        for group in values.chunks(ROWS * self.dim()) {
            let means = self.mean.iter().cycle();
            centred.iter_mut().zip(group).zip(means).for_each(|((to, from), mean)| *to = from.unit() - mean);
            let parts: [&[f32]; ROWS] = std::array::from_fn(|row| &centred[row * self.dim()..(row + 1) * self.dim()]);
            let mut sketches = [[0.0; SKETCH]; ROWS];
            for (at, panel) in self.panels.iter().enumerate() {
                for (sketch, sums) in sketches.iter_mut().zip(tile::<FUSED>(parts, panel)) {
                    sketch[at * LANES..(at + 1) * LANES].copy_from_slice(&sums);
                }
            }
            let filled = group.len() / self.dim();
            for (row, sketch) in sketches.iter_mut().enumerate() {
                self.complete(sketch, parts[row], row < filled);
            }
            rows.extend(sketches);
        }
        rows
    }

    /// Appends the length left over by the directions, and the product with the mean: with m the mean,
    /// a·b = (a − m)·(b − m) + (a·m − m·m / 2) + (b·m − m·m / 2).
    #[inline(always)]
    fn complete(&self, sketch: &mut [f32; SKETCH], centred: &[f32], real: bool) {
        let along: f32 = sketch[..DIRECTIONS].iter().map(|value| value * value).sum();
        let all: f32 = centred.iter().map(|value| value * value).sum();
        let with_mean: f32 = centred.iter().zip(&self.mean).map(|(value, mean)| (value + 0.5 * mean) * mean).sum();
        sketch[DIRECTIONS] = (all - along).max(0.0).sqrt();
        sketch[DIRECTIONS + 1] = if real { with_mean + SLACK } else { NEVER };
        sketch[DIRECTIONS + 2] = 1.0;
    }
}

/// Rows as columns, where the last two values change places: what a row brings alone meets the other's 1.
#[inline(always)]
fn panels_of(rows: &[[f32; SKETCH]]) -> Vec<[[f32; LANES]; SKETCH]> {
    let mut panels = vec![[[0.0; LANES]; SKETCH]; rows.len().div_ceil(LANES)];
    for (at, panel) in panels.iter_mut().enumerate() {
        panel[SKETCH - 2] = [1.0; LANES];
        panel[SKETCH - 1] = [NEVER; LANES];
        for (lane, row) in rows[at * LANES..].iter().take(LANES).enumerate() {
            for (k, column) in panel[..SKETCH - 2].iter_mut().enumerate() {
                column[lane] = row[k];
            }
            panel[SKETCH - 1][lane] = row[SKETCH - 2];
        }
    }
    panels
}

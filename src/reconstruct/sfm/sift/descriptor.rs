use pulp::{Arch, Simd, WithSimd};

use super::orientation::turn_of;
use super::refine::Extremum;
use super::rows::{MARGIN, Rows};
use ostra_core::image::lerp;

/// Side of a cell, in the keypoint's sigma.
const CELL: f32 = 3.0;
/// Cells along a side.
const CELLS: usize = 4;
const DIRECTIONS: usize = 8;
/// Half the side of the square that contributes to any cell, in cells: half a cell beyond the outer ones.
const HALF: f32 = 0.5 * (CELLS as f32 + 1.0);
/// Half the side of the square that a descriptor covers, in the sigma of its keypoint.
pub(super) const SUPPORT: f32 = HALF * CELL;
/// Samples across a cell: one per 0.75 sigma, which misses nothing of an image blurred by sigma.
const PER_CELL: usize = 4;
/// Samples across the square.
const SAMPLES: usize = PER_CELL * (CELLS + 1);
/// Distance of the farthest sample in the sigma of a keypoint, whatever its angle.
pub(super) const GRID_REACH: f32 =
    0.5 * (GRID as f32 - 1.0) * CELL / PER_CELL as f32 * std::f32::consts::SQRT_2;
/// Samples across the square with one more on each side for the gradients.
const GRID: usize = SAMPLES + 2;
/// Width of the Gaussian window in cells.
const WINDOW: f32 = 0.5 * CELLS as f32;
/// Largest share of the length that one value may have, so that a single strong gradient does not dominate.
const LARGEST: f32 = 0.2;
/// Maximum number of rows that a square can span.
const MOST_ROWS: usize = 256;

/// Sums per row of cells, cell and direction.
type CellHistograms = [[[f32; DIRECTIONS]; CELLS]; CELLS];

/// Computes descriptors: gradients on a grid rotated and scaled with the keypoint, in 4 × 4 cells × 8 directions.
///
/// D. Lowe, "Distinctive Image Features from Scale-Invariant Keypoints", IJCV 2004, section 6.
#[derive(Debug, Clone)]
pub(super) struct DescriptorWindow {
    /// Weight of each sample along a side for each cell, including the Gaussian window.
    weights: [[f32; CELLS]; SAMPLES],
}

impl DescriptorWindow {
    pub fn new() -> Self {
        let weight = |sample: usize, cell: usize| {
            let at = (sample as f32 + 0.5) / PER_CELL as f32 - HALF;
            let apart = (at - (cell as f32 - 0.5 * (CELLS as f32 - 1.0))).abs();
            (1.0 - apart).max(0.0) * (-0.5 * (at / WINDOW).powi(2)).exp()
        };
        Self {
            weights: std::array::from_fn(|sample| std::array::from_fn(|cell| weight(sample, cell))),
        }
    }

    /// Returns the descriptor of a keypoint of `sigma` samples of its octave, relative to the direction `angle`.
    pub fn describe(&self, level: &Rows, at: &Extremum, sigma: f32, angle: f32) -> [u8; 128] {
        let grid = grid(level, at, CELL / PER_CELL as f32 * sigma, angle);
        let cells = Arch::new().dispatch(Gather {
            grid: &grid,
            weights: &self.weights,
        });
        quantised(cells.as_flattened().as_flattened())
    }
}

/// Samples the image on the rotated grid, `step` samples of the octave apart.
fn grid(level: &Rows, at: &Extremum, step: f32, angle: f32) -> [[f32; GRID]; GRID] {
    let (sin, cos) = angle.sin_cos();
    let (right, down) = ((step * cos, step * sin), (-step * sin, step * cos));
    let middle = 0.5 * (GRID as f32 - 1.0);
    let reach = middle * step * (sin.abs() + cos.abs());
    let top = ((at.y - reach).floor().max(0.0) as usize).min(level.height - 1);
    let mut rows: [&[f32]; MOST_ROWS] = [&[]; MOST_ROWS];
    let bottom = ((at.y + reach).ceil() as usize + 1)
        .min(level.height - 1)
        .min(top + MOST_ROWS - 1);
    for (row, y) in rows.iter_mut().zip(top..=bottom) {
        *row = &level.with_margins(y)[MARGIN..];
    }
    let (last_x, last_y) = ((level.width - 1) as f32, (bottom - top) as f32);
    std::array::from_fn(|j| {
        let v = j as f32 - middle;
        std::array::from_fn(|i| {
            let u = i as f32 - middle;
            let x = (at.x + u * right.0 + v * down.0).clamp(0.0, last_x);
            let y = (at.y - top as f32 + u * right.1 + v * down.1).clamp(0.0, last_y);
            interpolated(&rows, x, y, bottom - top)
        })
    })
}

/// Interpolates bilinearly, with the last row repeated.
#[inline(always)]
fn interpolated(rows: &[&[f32]; MOST_ROWS], x: f32, y: f32, last: usize) -> f32 {
    let (column, row) = (x as i32 as usize, (y as i32 as usize) % MOST_ROWS);
    let (right, below) = (x - column as f32, y - row as f32);
    let along = |row: &[f32]| lerp(row[column], row[column + 1], right);
    let (upper, lower) = (
        along(rows[row]),
        along(rows[(row + 1).min(last) % MOST_ROWS]),
    );
    lerp(upper, lower, below)
}

/// Sums the gradients of a grid into cells.
struct Gather<'a> {
    grid: &'a [[f32; GRID]; GRID],
    weights: &'a [[f32; CELLS]; SAMPLES],
}

impl WithSimd for Gather<'_> {
    type Output = CellHistograms;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> CellHistograms {
        let mut cells = [[[0.0; DIRECTIONS]; CELLS]; CELLS];
        for (around, down) in self.grid.windows(3).zip(self.weights) {
            let row = sum_row(around, self.weights);
            for (sums, &weight) in cells.iter_mut().zip(down) {
                for (sum, value) in sums.as_flattened_mut().iter_mut().zip(row.as_flattened()) {
                    *sum += weight * value;
                }
            }
        }
        cells
    }
}

/// Sums the gradients of a row of samples into the cells along it.
#[inline(always)]
fn sum_row(around: &[[f32; GRID]], across: &[[f32; CELLS]; SAMPLES]) -> [[f32; DIRECTIONS]; CELLS] {
    let (mut lengths, mut directions) = ([0.0; SAMPLES], [0.0; SAMPLES]);
    for k in 0..SAMPLES {
        let dx = around[1][k + 2] - around[1][k];
        let dy = around[2][k + 1] - around[0][k + 1];
        lengths[k] = (dx * dx + dy * dy).sqrt();
        directions[k] = DIRECTIONS as f32 * turn_of(dx, dy);
    }
    let mut sums = [[0.0; DIRECTIONS]; CELLS];
    for k in 0..SAMPLES {
        let shares = direction_shares(directions[k], lengths[k]);
        for (sum, weight) in sums.iter_mut().zip(across[k]) {
            for (sum, share) in sum.iter_mut().zip(shares) {
                *sum += weight * share;
            }
        }
    }
    sums
}

/// Divides a gradient between the two nearest of the eight directions.
#[inline(always)]
fn direction_shares(direction: f32, length: f32) -> [f32; DIRECTIONS] {
    std::array::from_fn(|k| {
        let apart = (direction - k as f32).abs();
        let apart = if apart > 4.0 { 8.0 - apart } else { apart };
        length * if apart < 1.0 { 1.0 - apart } else { 0.0 }
    })
}

/// Returns the square roots of the values' shares, times 512.
///
/// R. Arandjelović and A. Zisserman, "Three things everyone should know to improve object
/// retrieval", CVPR 2012.
fn quantised(values: &[f32]) -> [u8; 128] {
    let length = values.iter().map(|value| value * value).sum::<f32>().sqrt();
    let capped = |value: f32| value.min(LARGEST * length);
    let sum = values
        .iter()
        .copied()
        .map(capped)
        .sum::<f32>()
        .max(f32::MIN_POSITIVE);
    let mut bytes = [0; 128];
    for (byte, &value) in bytes.iter_mut().zip(values) {
        *byte = (512.0 * (capped(value) / sum).sqrt() + 0.5).min(255.0) as u8;
    }
    bytes
}

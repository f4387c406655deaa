//! Maps that networks return: heat with its local maxima, and descriptors sampled between cells.

use glam::DVec2;
use rayon::prelude::*;

use ostra_core::image::bilinear_weights;

/// Probability of a keypoint at each pixel, 0–1.
#[derive(Debug, Clone, PartialEq)]
pub struct Heat {
    width: usize,
    values: Vec<f32>,
}

/// Side of the square of pixels that one cell of the network's output covers.
pub const CELL: usize = 8;
/// Channels per cell: its pixels, and "no keypoint here".
const CHANNELS: usize = CELL * CELL + 1;
/// Keypoints are at least this many pixels + 1 apart.
const RADIUS: usize = 2;

impl Heat {
    /// Converts the network's logits, `[65, rows / 8, columns / 8]`, by a softmax over the 65 channels of a cell.
    #[must_use]
    pub fn from_logits(logits: &[f32], columns: usize, rows: usize) -> Self {
        let (width, cells) = (columns * CELL, columns * rows);
        let mut values = vec![0.0; width * rows * CELL];
        values
            .par_chunks_mut(width * CELL)
            .enumerate()
            .for_each(|(row, band)| {
                for column in 0..columns {
                    let at = row * columns + column;
                    let shares =
                        softmax(std::array::from_fn(|channel| logits[channel * cells + at]));
                    for (line, shares) in shares[..CELL * CELL].chunks_exact(CELL).enumerate() {
                        let start = line * width + column * CELL;
                        band[start..start + CELL].copy_from_slice(shares);
                    }
                }
            });
        Self { width, values }
    }

    /// Returns the value of one pixel.
    #[must_use]
    pub fn at(&self, x: usize, y: usize) -> f32 {
        self.values[y * self.width + x]
    }

    /// Returns the pixels above `least` that are the largest of their 5 × 5 neighbourhood, row by row.
    ///
    /// Only the first `width` columns and `height` rows are searched. Of equal neighbours the first
    /// counts.
    #[must_use]
    pub fn peaks(&self, width: usize, height: usize, least: f32) -> Vec<(usize, usize)> {
        let in_row = |y: usize| {
            let row = &self.values[y * self.width..][..width];
            let above = row
                .iter()
                .enumerate()
                .filter(move |&(_, &value)| value > least);
            above
                .map(move |(x, _)| (x, y))
                .filter(|&(x, y)| self.is_peak(x, y))
                .collect::<Vec<_>>()
        };
        (0..height).into_par_iter().flat_map_iter(in_row).collect()
    }

    /// Returns the pixels above `least` that no stronger one suppresses within `radius` pixels, row by row.
    ///
    /// The radius holds along both axes. Only the first `width` columns and `height` rows are
    /// searched.
    #[must_use]
    pub fn separate(
        &self,
        width: usize,
        height: usize,
        least: f32,
        radius: usize,
    ) -> Vec<(usize, usize)> {
        let shown: Vec<f32> = self
            .values
            .chunks_exact(self.width)
            .take(height)
            .flat_map(|row| &row[..width])
            .copied()
            .collect();
        let kept = suppressed(&shown, width, radius);
        let kept = shown
            .iter()
            .zip(kept)
            .enumerate()
            .filter(|&(_, (&value, kept))| kept && value > least);
        kept.map(|(at, _)| (at % width, at / width)).collect()
    }

    fn is_peak(&self, x: usize, y: usize) -> bool {
        let value = self.at(x, y);
        let last = (self.width - 1, self.values.len() / self.width - 1);
        (y.saturating_sub(RADIUS)..=(y + RADIUS).min(last.1)).all(|other_y| {
            (x.saturating_sub(RADIUS)..=(x + RADIUS).min(last.0)).all(|other_x| {
                let other = self.at(other_x, other_y);
                other < value || (other == value && (other_y, other_x) >= (y, x))
            })
        })
    }

    /// Returns the position of a peak in pixels (centre of the top-left pixel at (0.5, 0.5)).
    ///
    /// It is the top of the parabolas through the logarithms of the peak and its neighbours,
    /// because the heat of a keypoint falls off like a Gaussian.
    #[must_use]
    pub fn refined(&self, x: usize, y: usize) -> DVec2 {
        let last = (self.width - 1, self.values.len() / self.width - 1);
        let along_x = (x > 0 && x < last.0)
            .then(|| top([self.at(x - 1, y), self.at(x, y), self.at(x + 1, y)]));
        let along_y = (y > 0 && y < last.1)
            .then(|| top([self.at(x, y - 1), self.at(x, y), self.at(x, y + 1)]));
        DVec2::new(
            x as f64 + 0.5 + along_x.unwrap_or(0.0),
            y as f64 + 0.5 + along_y.unwrap_or(0.0),
        )
    }
}

/// Returns the offset of the top of the parabola through three values' logarithms, −0.5–0.5.
fn top(values: [f32; 3]) -> f64 {
    let [before, at, after] = values.map(|value| f64::from(value.max(f32::MIN_POSITIVE)).ln());
    let bend = before - 2.0 * at + after;
    if bend < 0.0 {
        (0.5 * (before - after) / bend).clamp(-0.5, 0.5)
    } else {
        0.0
    }
}

fn softmax(mut values: [f32; CHANNELS]) -> [f32; CHANNELS] {
    let largest = values.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    values
        .iter_mut()
        .for_each(|value| *value = (*value - largest).exp());
    let sum: f32 = values.iter().sum();
    values.map(|value| value / sum)
}

/// Rounds in which values return that only a suppressed value had suppressed.
const ROUNDS: usize = 2;

/// Returns which values of an image, row by row, survive non-maximum suppression within `radius` pixels.
///
/// A value survives if it is the largest within the radius. Values that only suppressed pixels
/// exceed are compared again. This approximates suppression in order of the values, as the authors
/// of SuperPoint use it. Equal neighbours both stay.
pub fn suppressed(values: &[f32], width: usize, radius: usize) -> Vec<bool> {
    let mut kept: Vec<bool> = is_largest(values, &largest_around(values, width, radius));
    for _ in 0..ROUNDS {
        let near: Vec<f32> = kept
            .par_iter()
            .map(|&kept| f32::from(u8::from(kept)))
            .collect();
        let near = largest_around(&near, width, radius);
        let left: Vec<f32> = values
            .par_iter()
            .zip(&near)
            .map(|(&value, &near)| if near > 0.0 { 0.0 } else { value })
            .collect();
        let again = is_largest(&left, &largest_around(&left, width, radius));
        kept.par_iter_mut()
            .zip(again)
            .zip(&near)
            .for_each(|((kept, again), &near)| *kept |= again && near == 0.0);
    }
    kept
}

fn is_largest(values: &[f32], largest: &[f32]) -> Vec<bool> {
    values
        .par_iter()
        .zip(largest)
        .map(|(value, largest)| value == largest)
        .collect()
}

/// Returns the largest value within `radius` pixels along both axes.
fn largest_around(values: &[f32], width: usize, radius: usize) -> Vec<f32> {
    let height = values.len() / width;
    let mut along = vec![0.0; values.len()];
    along
        .par_chunks_exact_mut(width)
        .zip(values.par_chunks_exact(width))
        .for_each(|(into, row)| {
            for (x, into) in into.iter_mut().enumerate() {
                let near = &row[x.saturating_sub(radius)..(x + radius + 1).min(width)];
                *into = near.iter().copied().fold(f32::NEG_INFINITY, f32::max);
            }
        });
    let mut around = vec![f32::NEG_INFINITY; values.len()];
    around
        .par_chunks_exact_mut(width)
        .enumerate()
        .for_each(|(y, into)| {
            for row in along[y.saturating_sub(radius) * width..(y + radius + 1).min(height) * width]
                .chunks_exact(width)
            {
                into.iter_mut()
                    .zip(row)
                    .for_each(|(into, &value)| *into = into.max(value));
            }
        });
    around
}

/// A coarse grid of vectors, one per cell, interpolated between the cells.
#[derive(Debug, Clone, PartialEq)]
pub struct Sampled {
    columns: usize,
    rows: usize,
    dim: usize,
    /// Cell by cell, `dim` values each.
    values: Vec<f32>,
}

impl Sampled {
    /// Converts a network's output, `[dim, rows, columns]`.
    #[must_use]
    pub fn new(planes: &[f32], dim: usize, columns: usize, rows: usize) -> Self {
        let cells = columns * rows;
        let mut values = vec![0.0; dim * cells];
        for (channel, plane) in planes.chunks_exact(cells).enumerate() {
            values[channel..]
                .iter_mut()
                .step_by(dim)
                .zip(plane)
                .for_each(|(value, &given)| *value = given);
        }
        Self {
            columns,
            rows,
            dim,
            values,
        }
    }

    /// Scales each cell's values to length 1.
    #[must_use]
    pub fn normalised(mut self) -> Self {
        self.values.chunks_exact_mut(self.dim).for_each(normalise);
        self
    }

    /// Adds the values at a position in pixels (eight per cell) to `into`, bilinearly between the centres of the cells.
    pub fn read(&self, at: DVec2, into: &mut [f32]) {
        self.read_cells(at / CELL as f64 - 0.5, into);
    }

    /// Works like [`Self::read`], at a position in cells: the centre of the top-left cell is at (0, 0).
    pub fn read_cells(&self, at: DVec2, into: &mut [f32]) {
        let (column, along_x) = between(at.x, self.columns);
        let (row, along_y) = between(at.y, self.rows);
        let (next_column, next_row) = (
            (column + 1).min(self.columns - 1),
            (row + 1).min(self.rows - 1),
        );
        let corners = [
            (column, row),
            (next_column, row),
            (column, next_row),
            (next_column, next_row),
        ];
        for ((column, row), weight) in corners
            .into_iter()
            .zip(bilinear_weights([along_x, along_y]))
        {
            let cell = &self.values[(row * self.columns + column) * self.dim..][..self.dim];
            into.iter_mut()
                .zip(cell)
                .for_each(|(value, given)| *value += weight * given);
        }
    }
}

/// Scales values to length 1; zeros stay.
pub fn normalise(values: &mut [f32]) {
    let length = values.iter().map(|value| value * value).sum::<f32>().sqrt();
    if length > 0.0 {
        values.iter_mut().for_each(|value| *value /= length);
    }
}

/// Returns the cell before a position, and the share of the way to the next, 0–1.
fn between(at: f64, cells: usize) -> (usize, f32) {
    let at = at.clamp(0.0, (cells - 1) as f64);
    (at as usize, at.fract() as f32)
}

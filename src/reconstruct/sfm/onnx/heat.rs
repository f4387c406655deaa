use glam::DVec2;
use rayon::prelude::*;

use super::suppress::suppressed;

/// How likely each pixel is a keypoint, 0..1.
#[derive(Debug, Clone, PartialEq)]
pub struct Heat {
    width: usize,
    values: Vec<f32>,
}

/// Side of the square of pixels that one cell of the network's output tells about.
pub const CELL: usize = 8;
/// Pixels of a cell and "no keypoint here".
const CHANNELS: usize = CELL * CELL + 1;
/// Keypoints are at least this many pixels + 1 apart.
const RADIUS: usize = 2;

impl Heat {
    /// From the network's logits, `[65, rows / 8, columns / 8]`, softmax over the 65 channels of a cell.
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

    /// Value of one pixel.
    #[must_use]
    pub fn at(&self, x: usize, y: usize) -> f32 {
        self.values[y * self.width + x]
    }

    /// Pixels above `least` that are the largest of their 5 × 5 neighbourhood, within `width` columns and `height`
    /// rows, row by row; of equal neighbours the first.
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

    /// Pixels above `least` that no stronger one suppresses within `radius` pixels along both axes, within `width` columns
    /// and `height` rows, row by row.
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

    /// Position of a peak in pixels (centre of the top-left pixel at (0.5, 0.5)): top of the parabolas through the
    /// logarithms of it and its neighbours, as the heat of a keypoint falls off like a bell.
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

/// Offset of the top of the parabola through three values' logarithms, −0.5..0.5.
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

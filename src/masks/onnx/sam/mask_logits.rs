use rayon::prelude::*;

use super::part::{Canvas, ImagePart};
use crate::Region;
use ostra_core::image::ImageSize;

/// Weights of consecutive logits that sum to one pixel.
struct LogitTaps {
    first: usize,
    weights: Vec<f32>,
}

/// Enlarges `fine · fine` logits of the network's square to the size of a part of an image.
///
/// Returns `part.width · part.height` logits, row by row. As in the official code, logits are
/// interpolated bilinearly to the square, cropped to the area that shows the part, and interpolated
/// bilinearly to the part. If the part fills the square, this is a single step. Both steps are
/// weighted sums along rows and columns and are done at once.
pub(super) fn enlarged(logits: &[f32], fine: usize, part: ImagePart, canvas: Canvas) -> Vec<f32> {
    // With one pixel per logit, the step to the square changes nothing.
    let canvas = if canvas.is_filled {
        Canvas {
            side: fine,
            ..canvas
        }
    } else {
        canvas
    };
    let (shown, side) = (part.shown(canvas), canvas.side);
    let (width, height) = (part.width as usize, part.height as usize);
    let columns = taps(fine, side, shown.width, width);
    let mut wide = vec![0.0; fine * width];
    wide.par_chunks_mut(width)
        .zip(logits.par_chunks(fine))
        .for_each(|(out, row)| {
            out.iter_mut()
                .zip(&columns)
                .for_each(|(out, taps)| *out = taps.sum(|at| row[at]));
        });
    let rows = taps(fine, side, shown.height, height);
    let mut out = vec![0.0; width * height];
    out.par_chunks_mut(width)
        .zip(&rows)
        .for_each(|(out, taps)| {
            for (&weight, row) in taps
                .weights
                .iter()
                .zip(wide[taps.first * width..].chunks_exact(width))
            {
                out.iter_mut()
                    .zip(row)
                    .for_each(|(out, value)| *out += weight * value);
            }
        });
    out
}

/// Returns the weights from `fine` to `side`, cropped to `shown`, to `out`.
fn taps(fine: usize, side: usize, shown: usize, out: usize) -> Vec<LogitTaps> {
    let one = |at: usize| {
        let parts = between(at, out, shown);
        let both =
            parts.map(|(at, weight)| between(at, side, fine).map(|(at, part)| (at, part * weight)));
        let first = both
            .as_flattened()
            .iter()
            .map(|&(at, _)| at)
            .min()
            .unwrap_or(0);
        let last = both
            .as_flattened()
            .iter()
            .map(|&(at, _)| at)
            .max()
            .unwrap_or(0);
        let mut weights = vec![0.0; last - first + 1];
        both.as_flattened()
            .iter()
            .for_each(|&(at, weight)| weights[at - first] += weight as f32);
        LogitTaps { first, weights }
    };
    (0..out).map(one).collect()
}

/// Returns the two of `from` samples around sample `at` of `to`, with their weights.
fn between(at: usize, to: usize, from: usize) -> [(usize, f64); 2] {
    let place = ((at as f64 + 0.5) * from as f64 / to as f64 - 0.5).max(0.0);
    let first = (place as usize).min(from - 1);
    let share = place - first as f64;
    [(first, 1.0 - share), ((first + 1).min(from - 1), share)]
}

impl LogitTaps {
    fn sum(&self, value: impl Fn(usize) -> f32) -> f32 {
        self.weights
            .iter()
            .enumerate()
            .map(|(offset, weight)| weight * value(self.first + offset))
            .sum()
    }
}

/// Number of samples of a region along each side of a logit's cell.
const SAMPLES: usize = 4;
/// Logit of a cell that lies completely inside, about as high as those of the network.
const CONFIDENT: f32 = 10.0;

/// Converts a region of the image to logits that the decoder can refine.
///
/// Returns `fine · fine` logits of the square, from the share of each cell that is inside.
pub(super) fn hint(region: &Region, part: ImagePart, canvas: Canvas, fine: usize) -> Vec<f32> {
    let ImageSize {
        width: columns,
        height: rows,
    } = part.shown(canvas);
    let steps = fine * SAMPLES;
    // Image pixel under each sample along an axis; `None` in the padding.
    let along = |first: u32, count: u32, shown: usize| -> Vec<Option<u32>> {
        let pixel = |at: usize| {
            ((at as f64 + 0.5) * canvas.side as f64 / steps as f64 * f64::from(count)
                / shown as f64) as u32
        };
        (0..steps)
            .map(|at| {
                Some(pixel(at))
                    .filter(|&pixel| pixel < count)
                    .map(|pixel| first + pixel)
            })
            .collect()
    };
    let (across, down) = (
        along(part.x, part.width, columns),
        along(part.y, part.height, rows),
    );
    let mut inside = vec![0u32; fine * fine];
    for (y, row) in down.iter().enumerate() {
        for (x, column) in across.iter().enumerate() {
            let is_inside = column.zip(*row).is_some_and(|(x, y)| region.at(x, y));
            inside[y / SAMPLES * fine + x / SAMPLES] += u32::from(is_inside);
        }
    }
    let share = |&count: &u32| count as f32 / (SAMPLES * SAMPLES) as f32;
    inside
        .iter()
        .map(|count| CONFIDENT * (2.0 * share(count) - 1.0))
        .collect()
}

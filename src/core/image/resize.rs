//! Downscaling of images.
//!
//! The methods serve different purposes, and none replaces another: [`halve`] for pyramids,
//! [`block_means`] for integer factors, [`tent_shrink`] before feature detection (it leaves nothing
//! finer to alias), [`area_mean_rgb8`] for thumbnails (exact in integers). The filters that
//! networks were trained with are in `ostra_masks::onnx`.

use std::ops::Range;

/// Returns the mean of four values.
#[must_use]
#[inline(always)]
pub fn mean_of_four([a, b, c, d]: [f32; 4]) -> f32 {
    0.25 * (a + b + c + d)
}

/// Returns the image at half the size (at least 1 · 1).
///
/// Each pixel is the `mean` of upper left, upper right, lower left and lower right of four. An odd
/// last row or column is dropped.
#[must_use]
#[inline]
pub fn halve<T: Copy>(
    values: &[T],
    width: usize,
    height: usize,
    mean: impl Fn([T; 4]) -> T,
) -> Vec<T> {
    let (half_width, half_height) = ((width / 2).max(1), (height / 2).max(1));
    let mut halved = Vec::with_capacity(half_width * half_height);
    for y in 0..half_height {
        let upper = &values[2 * y * width..][..width];
        let lower = &values[(2 * y + 1).min(height - 1) * width..][..width];
        halved.extend(halve_row(upper, lower, &mean));
    }
    halved
}

/// Returns one row of the image at half the size, from two rows of the image; see [`halve`].
#[inline]
pub fn halve_row<'a, T: Copy>(
    upper: &'a [T],
    lower: &'a [T],
    mean: impl Fn([T; 4]) -> T + 'a,
) -> impl Iterator<Item = T> + 'a {
    // Rows of one pixel stay one pixel wide.
    let step = if upper.len() == 1 { 1 } else { 2 };
    let pairs = upper.chunks_exact(step).zip(lower.chunks_exact(step));
    pairs.map(move |(upper, lower)| mean([upper[0], upper[step - 1], lower[0], lower[step - 1]]))
}

/// Returns the means of squares of `step` pixels; incomplete rows and columns are dropped.
#[must_use]
pub fn block_means(values: &[f32], width: usize, step: usize) -> Vec<f32> {
    let mean = |rows: &[f32], x: usize| {
        let lines = rows
            .chunks_exact(width)
            .flat_map(|line| &line[x * step..(x + 1) * step]);
        lines.sum::<f32>() / (step * step) as f32
    };
    let bands = values.chunks_exact(width * step);
    bands
        .flat_map(|rows| (0..width / step).map(move |x| mean(rows, x)))
        .collect()
}

/// Returns a smaller image, filtered along rows and then along columns.
///
/// The filters are tents as wide as two pixels of the result, so that nothing finer is left to
/// alias. Sizes are columns and rows.
#[must_use]
pub fn tent_shrink(values: &[f32], from: [usize; 2], to: [usize; 2]) -> Vec<f32> {
    let across = tents(from[0], to[0]);
    let rows: Vec<f32> = values
        .chunks_exact(from[0])
        .flat_map(|row| across.iter().map(|tent| tent.sum(row, 1)))
        .collect();
    let down = tents(from[1], to[1]);
    down.iter()
        .flat_map(|tent| (0..to[0]).map(|x| tent.sum(&rows[x..], to[0])))
        .collect()
}

/// Weights of the samples from `first` on that sum to one sample of a smaller row.
struct Tent {
    first: usize,
    weights: Vec<f32>,
}

impl Tent {
    fn sum(&self, samples: &[f32], step: usize) -> f32 {
        let from = samples[self.first * step..].iter().step_by(step);
        from.zip(&self.weights)
            .map(|(sample, weight)| sample * weight)
            .sum()
    }
}

fn tents(from: usize, to: usize) -> Vec<Tent> {
    let ratio = from as f32 / to as f32;
    let one = |k: usize| {
        let centre = (k as f32 + 0.5) * ratio - 0.5;
        let first = (centre - ratio).ceil().max(0.0) as usize;
        let last = ((centre + ratio).floor() as usize).min(from - 1);
        let weight = |at: usize| (1.0 - (at as f32 - centre).abs() / ratio).max(0.0);
        let sum: f32 = (first..=last).map(weight).sum();
        Tent {
            first,
            weights: (first..=last).map(|at| weight(at) / sum).collect(),
        }
    };
    (0..to).map(one).collect()
}

/// Returns a smaller image whose pixels are rounded means of the pixels that they cover.
///
/// Each pixel is counted once. Sizes are columns and rows.
#[must_use]
pub fn area_mean_rgb8(pixels: &[[u8; 3]], from: [u32; 2], to: [u32; 2]) -> Vec<[u8; 3]> {
    let mut means = Vec::with_capacity(to[0] as usize * to[1] as usize);
    let mut sums = vec![[0_u64; 3]; to[0] as usize];
    for y in 0..to[1] {
        sums.fill([0; 3]);
        let rows = span(y, to[1], from[1]);
        let lines = pixels.chunks_exact(from[0] as usize);
        for row in lines.skip(rows.start).take(rows.len()) {
            add_row(&mut sums, row);
        }
        for (x, sum) in (0..to[0]).zip(&sums) {
            let count = (span(x, to[0], from[0]).len() * rows.len()) as u64;
            means.push(sum.map(|channel| ((channel + count / 2) / count) as u8));
        }
    }
    means
}

/// Returns the columns (or rows) of `from` that make up column `at` of `to`.
fn span(at: u32, to: u32, from: u32) -> Range<usize> {
    let edge = |at: u32| (u64::from(at) * u64::from(from) / u64::from(to)) as usize;
    edge(at)..edge(at + 1)
}

fn add_row(sums: &mut [[u64; 3]], row: &[[u8; 3]]) {
    let (to, from) = (sums.len() as u32, row.len() as u32);
    for (x, sum) in (0..to).zip(sums) {
        for pixel in &row[span(x, to, from)] {
            for (sum, channel) in sum.iter_mut().zip(pixel) {
                *sum += u64::from(*channel);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halving_drops_odd_rows_and_columns() {
        let values: Vec<f32> = (0..15).map(|at| at as f32).collect();
        assert_eq!(halve(&values, 5, 3, mean_of_four), [3.0, 5.0]);
        assert_eq!(halve(&values[..3], 1, 3, mean_of_four), [0.5]);
        assert_eq!(halve(&values[..3], 3, 1, mean_of_four), [0.5]);
        assert_eq!(halve(&values[..1], 1, 1, mean_of_four), [0.0]);
    }

    #[test]
    fn halving_uses_any_mean() {
        let taken = [true, false, false, false, false, false, false, false];
        let any = |four: [bool; 4]| four.contains(&true);
        assert_eq!(halve(&taken, 4, 2, any), [true, false]);
    }

    #[test]
    fn block_means_of_two_equal_halving() {
        let values: Vec<f32> = (0..24).map(|at| (at * at % 11) as f32).collect();
        assert_eq!(
            block_means(&values, 6, 2),
            halve(&values, 6, 4, mean_of_four)
        );
        assert_eq!(
            block_means(&values[..9], 3, 3),
            [values[..9].iter().sum::<f32>() / 9.0]
        );
    }

    #[test]
    fn tents_keep_even_images_and_average_fine_stripes() {
        assert!(
            tent_shrink(&[7.0; 12], [4, 3], [2, 2])
                .iter()
                .all(|value| (value - 7.0).abs() < 1e-5)
        );
        let stripes: Vec<f32> = (0..40).map(|at| (at % 2) as f32).collect();
        let shrunk = tent_shrink(&stripes, [40, 1], [10, 1]);
        assert!(
            shrunk[1..9].iter().all(|value| (value - 0.5).abs() < 0.01),
            "{shrunk:?}"
        );
    }

    #[test]
    fn area_means_are_rounded() {
        let pixels: Vec<[u8; 3]> = (0..8 * 4)
            .map(|at| [if at % 8 < 4 { 10 } else { 200 }, at as u8, 7])
            .collect();
        assert_eq!(
            area_mean_rgb8(&pixels, [8, 4], [2, 1]),
            [[10, 14, 7], [200, 18, 7]]
        );
        assert_eq!(area_mean_rgb8(&pixels, [8, 4], [8, 4]), pixels);
    }
}

use rayon::prelude::*;

use super::network::OBJECTS;
use crate::networks::{LinearSample, corner_aligned_samples, odds};
use ostra_compute::nn::{NnError, Tensor};
use ostra_core::image::{ImageSize, blend};
use ostra_frames::Image;

/// Side of a cell in pixels; the first and the last pixel of a row are cell centres.
const CELL: f64 = 16.0;
/// Mean and standard deviation of red, green and blue in the encoder's training.
const MEAN: [f32; 3] = [0.485, 0.456, 0.406];
const DEVIATION: [f32; 3] = [0.229, 0.224, 0.225];
/// Slope of the cubic filter at a distance of one pixel.
const SLOPE: f64 = -0.75;

/// Returns the size of the network's input for an image size.
///
/// The longer side is reduced to at most `longest`. Both sides are then rounded to a whole number
/// of cells plus one pixel.
pub(super) fn shown_size(width: u32, height: u32, longest: u32) -> ImageSize {
    let scale = (f64::from(longest) / f64::from(width.max(height))).min(1.0);
    let whole = |side: u32| {
        let side = (f64::from(side) * scale).trunc();
        (((side - 1.0) / CELL).round_ties_even() * CELL) as usize + 1
    };
    ImageSize::new(whole(width), whole(height))
}

/// Resizes the image to `shown` and normalizes it: `[1, 3, rows, columns]`.
pub(super) fn fed(image: &Image, shown: ImageSize) -> Result<Tensor, NnError> {
    let ImageSize { width, height } = image.size();
    let (columns, rows) = (taps(width, shown.width), taps(height, shown.height));
    let mut wide = vec![[0.0f32; 3]; shown.width * height];
    wide.par_chunks_mut(shown.width)
        .zip(image.pixels.par_chunks(width))
        .for_each(|(out, row)| {
            out.iter_mut()
                .zip(&columns)
                .for_each(|(out, taps)| *out = sum(taps, |at| row[at].map(f32::from)));
        });
    let mut planes = vec![0.0; 3 * shown.width * shown.height];
    planes
        .par_chunks_mut(shown.width)
        .enumerate()
        .for_each(|(line, out)| {
            let (channel, row) = (line / shown.height, line % shown.height);
            out.iter_mut().enumerate().for_each(|(x, out)| {
                let value = sum(&rows[row], |at| [wide[at * shown.width + x][channel]]);
                *out = (value[0] / 255.0 - MEAN[channel]) / DEVIATION[channel];
            });
        });
    Tensor::floats(&[1, 3, shown.height, shown.width], planes)
}

/// Four source pixels and their weights.
type BilinearTaps = [(usize, f32); 4];

/// Returns the weights of OpenCV's cubic interpolation.
///
/// It does not smooth when it reduces an image. The border pixels are repeated.
fn taps(from: usize, to: usize) -> Vec<BilinearTaps> {
    let scale = from as f64 / to as f64;
    let one = |at: usize| {
        let place = (at as f64 + 0.5) * scale - 0.5;
        let offset = place - place.floor();
        let near = |x: f64| ((SLOPE + 2.0) * x - (SLOPE + 3.0)) * x * x + 1.0;
        let far = |x: f64| ((SLOPE * x - 5.0 * SLOPE) * x + 8.0 * SLOPE) * x - 4.0 * SLOPE;
        let weights = [
            far(offset + 1.0),
            near(offset),
            near(1.0 - offset),
            far(2.0 - offset),
        ];
        let at = |step: i64| (place.floor() as i64 + step).clamp(0, from as i64 - 1) as usize;
        std::array::from_fn(|step| (at(step as i64 - 1), weights[step] as f32))
    };
    (0..to).map(one).collect()
}

fn sum<const N: usize>(taps: &BilinearTaps, pixel: impl Fn(usize) -> [f32; N]) -> [f32; N] {
    let mut sums = [0.0; N];
    for &(at, weight) in taps {
        sums.iter_mut()
            .zip(pixel(at))
            .for_each(|(sum, value)| *sum += weight * value);
    }
    sums
}

/// Resizes a map of numbers from `from` to `shown` by nearest neighbour.
pub(super) fn nearest(numbers: &[usize], from: ImageSize, shown: ImageSize) -> Vec<usize> {
    let places = |from: usize, to: usize| -> Vec<usize> {
        let scale = from as f32 / to as f32;
        (0..to)
            .map(|at| ((at as f32 * scale) as usize).min(from - 1))
            .collect()
    };
    let (columns, rows) = (
        places(from.width, shown.width),
        places(from.height, shown.height),
    );
    rows.iter()
        .flat_map(|&y| columns.iter().map(move |&x| numbers[y * from.width + x]))
        .collect()
}

/// Margin of probabilities to 0 and 1 when groups of objects are merged.
const MARGIN: f32 = 1e-5;

/// Returns the probabilities of the background and of every object.
///
/// The result is `[1 + objects][height][width]`, for an image of `size`, from the
/// logits of every group of ten. With several groups, the background is where no group sees an
/// object, and objects compete by their odds (soft aggregation).
pub(super) fn probabilities(groups: &[&Tensor], objects: usize, size: ImageSize) -> Vec<f32> {
    let ImageSize { width, height } = size;
    let mut values = vec![0.0; (objects + 1) * width * height];
    let mut rows: Vec<Vec<&mut [f32]>> = (0..height)
        .map(|_| Vec::with_capacity(objects + 1))
        .collect();
    for plane in values.chunks_exact_mut(width * height) {
        rows.iter_mut()
            .zip(plane.chunks_exact_mut(width))
            .for_each(|(row, line)| row.push(line));
    }
    let enlarged: Vec<Enlarged<'_>> = groups
        .iter()
        .map(|logits| Enlarged::new(logits, size))
        .collect();
    rows.into_par_iter().enumerate().for_each(|(y, mut row)| {
        let (nothing, row) = row.split_at_mut(1);
        nothing[0].fill(1.0);
        for (group, lines) in enlarged.iter().zip(row.chunks_mut(OBJECTS)) {
            group.probabilities(y, nothing[0], lines);
        }
        if groups.len() > 1 {
            together(nothing[0], row);
        }
    });
    values
}

/// Logits of a group, interpolated to the image size with aligned corners.
struct Enlarged<'a> {
    logits: &'a [f32],
    from: ImageSize,
    columns: Vec<LinearSample>,
    rows: Vec<LinearSample>,
}

impl<'a> Enlarged<'a> {
    fn new(logits: &'a Tensor, size: ImageSize) -> Self {
        let from = ImageSize::new(logits.shape()[3], logits.shape()[2]);
        Self {
            logits: logits.as_floats(),
            from,
            columns: corner_aligned_samples(from.width, size.width),
            rows: corner_aligned_samples(from.height, size.height),
        }
    }

    fn line(&self, channel: usize, y: usize, out: &mut [f32]) {
        let ImageSize {
            width: columns,
            height: rows,
        } = self.from;
        let row = self.rows[y];
        let plane = &self.logits[channel * columns * rows..][..columns * rows];
        let (above, below) = (&plane[row.first * columns..], &plane[row.next * columns..]);
        for (out, column) in out.iter_mut().zip(&self.columns) {
            let between =
                |line: &[f32]| blend(line[column.first], line[column.next], column.weight);
            *out = blend(between(above), between(below), row.weight);
        }
    }

    /// Computes row `y`: multiplies `nothing` and writes the objects of the group.
    fn probabilities(&self, y: usize, nothing: &mut [f32], objects: &mut [&mut [f32]]) {
        let mut own = vec![0.0; nothing.len()];
        self.line(0, y, &mut own);
        objects
            .iter_mut()
            .enumerate()
            .for_each(|(at, line)| self.line(at + 1, y, line));
        for (x, (nothing, own)) in nothing.iter_mut().zip(own).enumerate() {
            let most = objects.iter().map(|line| line[x]).fold(own, f32::max);
            let own = (own - most).exp();
            let mut sum = own;
            for line in objects.iter_mut() {
                line[x] = (line[x] - most).exp();
                sum += line[x];
            }
            *nothing *= own / sum;
            objects.iter_mut().for_each(|line| line[x] /= sum);
        }
    }
}

/// Converts one row of all groups to odds, and normalizes these to probabilities.
fn together(nothing: &mut [f32], objects: &mut [&mut [f32]]) {
    for (x, nothing) in nothing.iter_mut().enumerate() {
        *nothing = odds(*nothing, MARGIN);
        let mut sum = *nothing;
        for line in objects.iter_mut() {
            line[x] = odds(line[x], MARGIN);
            sum += line[x];
        }
        *nothing /= sum;
        objects.iter_mut().for_each(|line| line[x] /= sum);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::propagate::most_probable;

    #[test]
    fn input_sizes_are_whole_cells_plus_one_pixel() {
        // Values of the official test transform.
        assert_eq!(shown_size(640, 480, 1040), ImageSize::new(641, 481));
        assert_eq!(shown_size(1920, 1080, 1040), ImageSize::new(1041, 577));
        assert_eq!(shown_size(1080, 1920, 1040), ImageSize::new(577, 1041));
        assert_eq!(
            shown_size(41, 25, 1040),
            ImageSize::new(33, 33),
            "halves go to the even number of cells"
        );
    }

    #[test]
    fn resizing_to_the_same_size_only_normalizes() {
        let pixels = (0..17 * 17)
            .map(|at| [at as u8, 7, 255 - at as u8])
            .collect();
        let fed = fed(
            &Image {
                width: 17,
                height: 17,
                pixels,
            },
            ImageSize::new(17, 17),
        )
        .unwrap();
        assert_eq!(fed.shape(), [1, 3, 17, 17]);
        let expected = (200.0 / 255.0 - MEAN[0]) / DEVIATION[0];
        assert!((fed.as_floats()[200] - expected).abs() < 1e-6);
    }

    #[test]
    fn cubic_interpolation_matches_opencv() {
        // Values of cv2.resize with INTER_CUBIC.
        let resized = |row: &[f32], to: usize| -> Vec<f32> {
            taps(row.len(), to)
                .iter()
                .map(|taps| sum(taps, |at| [row[at]])[0])
                .collect()
        };
        let expected = [
            -10.546875, 22.65625, 77.34375, 110.546875, 103.515625, 100.0,
        ];
        assert_eq!(resized(&[0.0, 100.0, 100.0], 6), expected);
        assert_eq!(
            resized(&[0.0, 0.0, 100.0, 200.0, 200.0, 200.0], 3),
            [-9.375, 159.375, 200.0]
        );
    }

    fn logits(of: [[f32; 2]; 3]) -> Tensor {
        let mut values = vec![0.0; (OBJECTS + 1) * 2];
        values[..6].copy_from_slice(of.as_flattened());
        Tensor::floats(&[1, OBJECTS + 1, 1, 2], values).unwrap()
    }

    #[test]
    fn corners_are_aligned_and_unused_channels_are_ignored() {
        let found = probabilities(
            &[&logits([[0.0, 0.0], [2.0, 0.0], [9.0, 9.0]])],
            1,
            ImageSize::new(3, 1),
        );
        let sigmoid = |value: f32| 1.0 / (1.0 + (-value).exp());
        let expected = [2.0, 1.0, 0.0].map(sigmoid);
        for (x, expected) in expected.into_iter().enumerate() {
            assert!(
                (found[3 + x] - expected).abs() < 1e-6
                    && (found[x] + found[3 + x] - 1.0).abs() < 1e-6
            );
        }
    }

    #[test]
    fn groups_compete_by_their_odds() {
        let first = logits([[0.0; 2], [1.0; 2], [0.0; 2]]);
        let second = logits([[0.0; 2], [2.0; 2], [0.0; 2]]);
        let found = probabilities(&[&first, &second], 11, ImageSize::new(2, 1));
        let sum: f32 = found.iter().step_by(2).sum();
        assert!((sum - 1.0).abs() < 1e-5);
        // Ten objects with logits 1, 0 … 0 against the background, and one with 2.
        let (of_first, of_second) = (
            1f64.exp() / (10.0 + 1f64.exp()),
            2f64.exp() / (1.0 + 2f64.exp()),
        );
        let odds = |value: f64| value / (1.0 - value);
        let expected = odds(of_second) / odds(of_first);
        assert!((f64::from(found[22] / found[2]) / expected - 1.0).abs() < 1e-4);
        assert_eq!(
            most_probable(&found, 2)
                .iter()
                .map(|&(number, _)| number)
                .collect::<Vec<_>>(),
            [11, 11]
        );
    }
}

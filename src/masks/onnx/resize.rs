use rayon::prelude::*;

use ostra_core::image::ImageSize;

/// Fractional bits of a weight.
const PRECISION: u32 = 22;

/// Weights of consecutive source pixels that sum to one new pixel.
struct ResizeTaps {
    first: usize,
    weights: Vec<i64>,
}

/// Resizes an image from `from` to `to` exactly as Pillow's bilinear filter does.
///
/// The result is bit-identical to Pillow's, with which the networks were trained: a triangle filter
/// as wide as a new pixel where the image shrinks, rounded to bytes after the rows and after the
/// columns.
pub(super) fn resized(pixels: &[[u8; 3]], from: ImageSize, to: ImageSize) -> Vec<[u8; 3]> {
    let columns = taps(from.width, to.width);
    let mut wide = vec![[0; 3]; to.width * from.height];
    wide.par_chunks_mut(to.width)
        .zip(pixels.par_chunks(from.width))
        .for_each(|(out, row)| {
            out.iter_mut()
                .zip(&columns)
                .for_each(|(out, taps)| *out = taps.sum(|at| row[at]));
        });
    let rows = taps(from.height, to.height);
    let mut out = vec![[0; 3]; to.width * to.height];
    out.par_chunks_mut(to.width)
        .zip(&rows)
        .for_each(|(out, taps)| {
            out.iter_mut()
                .enumerate()
                .for_each(|(x, out)| *out = taps.sum(|at| wide[at * to.width + x]));
        });
    out
}

/// Resizes an image like PyTorch's bilinear filter with antialiasing, without rounding.
///
/// The result is `[3, rows, columns]`, 0–255.
pub fn resized_planes(pixels: &[[u8; 3]], from: ImageSize, to: ImageSize) -> Vec<f32> {
    let columns = weights(from.width, to.width);
    let mut wide = vec![[0.0f32; 3]; to.width * from.height];
    wide.par_chunks_mut(to.width)
        .zip(pixels.par_chunks(from.width))
        .for_each(|(out, row)| {
            for (out, (first, weights)) in out.iter_mut().zip(&columns) {
                for (weight, pixel) in weights.iter().zip(&row[*first..]) {
                    out.iter_mut()
                        .zip(pixel)
                        .for_each(|(sum, &value)| *sum += *weight as f32 * f32::from(value));
                }
            }
        });
    let rows = weights(from.height, to.height);
    let mut out = vec![0.0; 3 * to.width * to.height];
    out.par_chunks_mut(to.width)
        .enumerate()
        .for_each(|(line, out)| {
            let (channel, (first, weights)) = (line / to.height, &rows[line % to.height]);
            for (weight, row) in weights
                .iter()
                .zip(wide[first * to.width..].chunks_exact(to.width))
            {
                out.iter_mut()
                    .zip(row)
                    .for_each(|(sum, value)| *sum += *weight as f32 * value[channel]);
            }
        });
    out
}

fn taps(from: usize, to: usize) -> Vec<ResizeTaps> {
    let fixed = |weight: f64| (weight * f64::from(1 << PRECISION) + 0.5) as i64;
    let one = |(first, weights): (usize, Vec<f64>)| ResizeTaps {
        first,
        weights: weights.into_iter().map(fixed).collect(),
    };
    weights(from, to).into_iter().map(one).collect()
}

/// Returns the first source pixel of each new pixel, and the weights from there on; they sum to 1.
fn weights(from: usize, to: usize) -> Vec<(usize, Vec<f64>)> {
    let scale = from as f64 / to as f64;
    let reach = scale.max(1.0);
    let one = |at: usize| {
        let middle = (at as f64 + 0.5) * scale;
        let first = (middle - reach + 0.5).max(0.0) as usize;
        let end = ((middle + reach + 0.5) as usize).min(from);
        let weight = |at: usize| (1.0 - ((at as f64 - middle + 0.5) / reach).abs()).max(0.0);
        let sum: f64 = (first..end).map(weight).sum();
        (first, (first..end).map(|at| weight(at) / sum).collect())
    };
    (0..to).map(one).collect()
}

impl ResizeTaps {
    fn sum(&self, pixel: impl Fn(usize) -> [u8; 3]) -> [u8; 3] {
        let mut sums = [1i64 << (PRECISION - 1); 3];
        for (offset, &weight) in self.weights.iter().enumerate() {
            let pixel = pixel(self.first + offset);
            sums.iter_mut()
                .zip(pixel)
                .for_each(|(sum, value)| *sum += weight * i64::from(value));
        }
        sums.map(|sum| (sum >> PRECISION).clamp(0, 255) as u8)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn resizing_to_the_same_size_changes_nothing() {
        let pixels: Vec<[u8; 3]> = (0..15).map(|at| [at, 2 * at, 255 - at]).collect();
        assert_eq!(
            resized(&pixels, ImageSize::new(5, 3), ImageSize::new(5, 3)),
            pixels
        );
    }

    #[test]
    fn planes_equal_the_rounded_image() {
        let pixels: Vec<[u8; 3]> = (0..63u8).map(|at| [at, 3 * at, 255 - at]).collect();
        let from = ImageSize::new(9, 7);
        for to in [ImageSize::new(4, 5), ImageSize::new(20, 11)] {
            let (bytes, planes) = (
                resized(&pixels, from, to),
                resized_planes(&pixels, from, to),
            );
            for (channel, plane) in planes.chunks_exact(to.area()).enumerate() {
                let near = |(byte, value): (&[u8; 3], &f32)| {
                    (f32::from(byte[channel]) - value).abs() <= 1.01
                };
                assert!(
                    bytes.iter().zip(plane).all(near),
                    "two roundings of half a step"
                );
            }
        }
    }

    #[test]
    fn shrinking_averages_and_enlarging_interpolates() {
        // By hand: weights 1 3 3 1 of a triangle over four pixels, clipped at the edges; then
        // quarters between two pixels.
        let row = [0, 0, 100, 200, 200, 200].map(|value| [value; 3]);
        assert_eq!(
            resized(&row, ImageSize::new(6, 1), ImageSize::new(3, 1)),
            [14, 138, 200].map(|value| [value; 3])
        );
        let pair = [0, 100].map(|value| [value; 3]);
        assert_eq!(
            resized(&pair, ImageSize::new(2, 1), ImageSize::new(4, 1)),
            [0, 25, 75, 100].map(|value| [value; 3])
        );
    }
}

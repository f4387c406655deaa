use rayon::prelude::*;

/// Bits behind the point of a weight.
const PRECISION: u32 = 22;

/// Weights with which pixels in a row are summed to one new pixel.
struct Taps {
    first: usize,
    weights: Vec<i64>,
}

/// A picture of `from` (columns, rows) at the size of `to`, bit for bit as Pillow's bilinear filter makes it, which
/// networks were trained with: a triangle as wide as a new pixel where it shrinks, rounded to bytes after the rows and
/// after the columns.
pub(super) fn resized(pixels: &[[u8; 3]], from: (usize, usize), to: (usize, usize)) -> Vec<[u8; 3]> {
    let columns = taps(from.0, to.0);
    let mut wide = vec![[0; 3]; to.0 * from.1];
    wide.par_chunks_mut(to.0).zip(pixels.par_chunks(from.0)).for_each(|(out, row)| {
        out.iter_mut().zip(&columns).for_each(|(out, taps)| *out = taps.sum(|at| row[at]));
    });
    let rows = taps(from.1, to.1);
    let mut out = vec![[0; 3]; to.0 * to.1];
    out.par_chunks_mut(to.0).zip(&rows).for_each(|(out, taps)| {
        out.iter_mut().enumerate().for_each(|(x, out)| *out = taps.sum(|at| wide[at * to.0 + x]));
    });
    out
}

fn taps(from: usize, to: usize) -> Vec<Taps> {
    let scale = from as f64 / to as f64;
    let reach = scale.max(1.0);
    let one = |at: usize| {
        let middle = (at as f64 + 0.5) * scale;
        let first = (middle - reach + 0.5).max(0.0) as usize;
        let end = ((middle + reach + 0.5) as usize).min(from);
        let weight = |at: usize| (1.0 - ((at as f64 - middle + 0.5) / reach).abs()).max(0.0);
        let sum: f64 = (first..end).map(weight).sum();
        let fixed = |at: usize| (weight(at) / sum * f64::from(1 << PRECISION) + 0.5) as i64;
        Taps { first, weights: (first..end).map(fixed).collect() }
    };
    (0..to).map(one).collect()
}

impl Taps {
    fn sum(&self, pixel: impl Fn(usize) -> [u8; 3]) -> [u8; 3] {
        let mut sums = [1i64 << (PRECISION - 1); 3];
        for (offset, &weight) in self.weights.iter().enumerate() {
            let pixel = pixel(self.first + offset);
            sums.iter_mut().zip(pixel).for_each(|(sum, value)| *sum += weight * i64::from(value));
        }
        sums.map(|sum| (sum >> PRECISION).clamp(0, 255) as u8)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_size_changes_nothing() {
        let pixels: Vec<[u8; 3]> = (0..15).map(|at| [at, 2 * at, 255 - at]).collect();
        assert_eq!(resized(&pixels, (5, 3), (5, 3)), pixels);
    }

    #[test]
    fn shrinking_averages_and_enlarging_goes_between() {
        // By hand: weights 1 3 3 1 of a triangle over four pixels, cut at the edges; then quarters between two.
        let row = [0, 0, 100, 200, 200, 200].map(|value| [value; 3]);
        assert_eq!(resized(&row, (6, 1), (3, 1)), [14, 138, 200].map(|value| [value; 3]));
        let pair = [0, 100].map(|value| [value; 3]);
        assert_eq!(resized(&pair, (2, 1), (4, 1)), [0, 25, 75, 100].map(|value| [value; 3]));
    }
}

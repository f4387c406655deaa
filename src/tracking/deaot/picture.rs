use rayon::prelude::*;

use ostra_compute::nn::{NnError, Tensor};
use ostra_frames::Image;

/// Pixels along each side of a cell; the first and the last pixel of a row are the middles of cells.
const CELL: f64 = 16.0;
/// Mean and deviation of red, green and blue that the encoder was trained with.
const MEAN: [f32; 3] = [0.485, 0.456, 0.406];
const DEVIATION: [f32; 3] = [0.229, 0.224, 0.225];
/// Slope of the cubic filter at a distance of one pixel.
const SLOPE: f64 = -0.75;

/// Columns and rows at which the network sees a picture: at most `longest` on the longer side, then to the nearest whole
/// number of cells and one pixel.
pub(super) fn shown_size(width: u32, height: u32, longest: u32) -> (usize, usize) {
    let scale = (f64::from(longest) / f64::from(width.max(height))).min(1.0);
    let whole = |side: u32| {
        let side = (f64::from(side) * scale).trunc();
        (((side - 1.0) / CELL).round_ties_even() * CELL) as usize + 1
    };
    (whole(width), whole(height))
}

/// The picture at the size of `shown` (columns, rows), normalised, `[1, 3, rows, columns]`.
pub(super) fn fed(image: &Image, shown: (usize, usize)) -> Result<Tensor, NnError> {
    let (width, height) = (image.width as usize, image.height as usize);
    let (columns, rows) = (taps(width, shown.0), taps(height, shown.1));
    let mut wide = vec![[0.0f32; 3]; shown.0 * height];
    wide.par_chunks_mut(shown.0)
        .zip(image.pixels.par_chunks(width))
        .for_each(|(out, row)| {
            out.iter_mut()
                .zip(&columns)
                .for_each(|(out, taps)| *out = sum(taps, |at| row[at].map(f32::from)));
        });
    let mut planes = vec![0.0; 3 * shown.0 * shown.1];
    planes
        .par_chunks_mut(shown.0)
        .enumerate()
        .for_each(|(line, out)| {
            let (channel, row) = (line / shown.1, line % shown.1);
            out.iter_mut().enumerate().for_each(|(x, out)| {
                let value = sum(&rows[row], |at| [wide[at * shown.0 + x][channel]]);
                *out = (value[0] / 255.0 - MEAN[channel]) / DEVIATION[channel];
            });
        });
    Tensor::floats(&[1, 3, shown.1, shown.0], planes)
}

/// Which four pixels make one, and with what weight.
type Taps = [(usize, f32); 4];

/// Of OpenCV's cubic interpolation, which does not smooth where it shrinks; beyond the edge lies the edge.
fn taps(from: usize, to: usize) -> Vec<Taps> {
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

fn sum<const N: usize>(taps: &Taps, pixel: impl Fn(usize) -> [f32; N]) -> [f32; N] {
    let mut sums = [0.0; N];
    for &(at, weight) in taps {
        sums.iter_mut()
            .zip(pixel(at))
            .for_each(|(sum, value)| *sum += weight * value);
    }
    sums
}

/// For every pixel of `shown` (columns, rows) the number at the nearest pixel of a picture of `from`.
pub(super) fn nearest(
    numbers: &[usize],
    from: (usize, usize),
    shown: (usize, usize),
) -> Vec<usize> {
    let places = |from: usize, to: usize| -> Vec<usize> {
        let scale = from as f32 / to as f32;
        (0..to)
            .map(|at| ((at as f32 * scale) as usize).min(from - 1))
            .collect()
    };
    let (columns, rows) = (places(from.0, shown.0), places(from.1, shown.1));
    rows.iter()
        .flat_map(|&y| columns.iter().map(move |&x| numbers[y * from.0 + x]))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_whole_cells_and_one_pixel() {
        // As the official test transform gives them.
        assert_eq!(shown_size(640, 480, 1040), (641, 481));
        assert_eq!(shown_size(1920, 1080, 1040), (1041, 577));
        assert_eq!(shown_size(1080, 1920, 1040), (577, 1041));
        assert_eq!(
            shown_size(41, 25, 1040),
            (33, 33),
            "halves go to the even number of cells"
        );
    }

    #[test]
    fn same_size_changes_nothing_but_the_scale() {
        let pixels = (0..17 * 17)
            .map(|at| [at as u8, 7, 255 - at as u8])
            .collect();
        let fed = fed(
            &Image {
                width: 17,
                height: 17,
                pixels,
            },
            (17, 17),
        )
        .unwrap();
        assert_eq!(fed.shape(), [1, 3, 17, 17]);
        let expected = (200.0 / 255.0 - MEAN[0]) / DEVIATION[0];
        assert!((fed.as_floats()[200] - expected).abs() < 1e-6);
    }

    #[test]
    fn enlarging_goes_beyond_what_is_there() {
        // As cv2.resize gives them with INTER_CUBIC.
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
}

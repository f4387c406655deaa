//! Interpolation between pixels.
//!
//! There are two forms of linear interpolation, which round differently; callers whose results must
//! stay bit-identical keep theirs. [`lerp`] and [`bilinear`] step from one value towards the next.
//! [`blend`], [`bilinear_weights`] and [`Corners`] sum weighted values, which also works if the
//! values are vectors or rows of channels.

use crate::statistics::Real;

/// Returns `a + share · (b − a)`: exactly `a` at 0, `b` up to rounding at 1.
#[must_use]
#[inline(always)]
pub fn lerp<T: Real>(a: T, b: T, share: T) -> T {
    a + share * (b - a)
}

/// Returns `(1 − share) · a + share · b`: exactly `a` at 0 and `b` at 1.
#[must_use]
#[inline(always)]
pub fn blend<T: Real>(a: T, b: T, share: T) -> T {
    (T::ONE - share) * a + share * b
}

/// Returns the value between four: upper left, upper right, lower left, lower right.
///
/// `share` goes from 0 to 1 to the right and down.
#[must_use]
#[inline(always)]
pub fn bilinear<T: Real>([a, b, c, d]: [T; 4], share: [T; 2]) -> T {
    lerp(lerp(a, b, share[0]), lerp(c, d, share[0]), share[1])
}

/// Returns the weights of upper left, upper right, lower left and lower right.
///
/// `share` goes from 0 to 1 to the right and down.
#[must_use]
#[inline(always)]
pub fn bilinear_weights<T: Real>([u, v]: [T; 2]) -> [T; 4] {
    [
        (T::ONE - u) * (T::ONE - v),
        u * (T::ONE - v),
        (T::ONE - u) * v,
        u * v,
    ]
}

/// The four pixels around a position, and their bilinear weights.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corners {
    /// Indices of upper left, upper right, lower left and lower right.
    pub pixels: [usize; 4],
    /// Weights, which sum to 1.
    pub weights: [f32; 4],
}

impl Corners {
    /// Returns the pixels around a position, where the centre of the top-left pixel is (0, 0).
    ///
    /// Positions beyond the border are moved to the nearest position within the image.
    #[must_use]
    #[inline(always)]
    pub fn around([x, y]: [f32; 2], width: usize, height: usize) -> Self {
        let x = x.clamp(0.0, width as f32 - 1.0);
        let y = y.clamp(0.0, height as f32 - 1.0);
        let (left, top) = (x as usize, y as usize);
        let (right, below) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
        Self {
            pixels: [
                top * width + left,
                top * width + right,
                below * width + left,
                below * width + right,
            ],
            weights: bilinear_weights([x - left as f32, y - top as f32]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GREY: [f32; 6] = [0.0, 10.0, 20.0, 30.0, 50.0, 70.0];

    fn sampled(at: [f32; 2]) -> f32 {
        let Corners { pixels, weights } = Corners::around(at, 3, 2);
        pixels
            .iter()
            .zip(weights)
            .map(|(&pixel, weight)| GREY[pixel] * weight)
            .sum()
    }

    #[test]
    fn sampling_at_pixel_centres_returns_the_pixels() {
        for (at, &grey) in GREY.iter().enumerate() {
            assert_eq!(sampled([(at % 3) as f32, (at / 3) as f32]), grey);
        }
    }

    #[test]
    fn positions_beyond_the_border_are_clamped() {
        assert_eq!(sampled([-4.0, -1.0]), 0.0);
        assert_eq!(sampled([9.0, 0.5]), 45.0);
        assert_eq!(sampled([1.5, 7.0]), 60.0);
    }

    #[test]
    fn both_forms_interpolate_linearly() {
        assert_eq!((lerp(2.0, 6.0, 0.25), blend(2.0, 6.0, 0.25)), (3.0, 3.0));
        assert_eq!(
            (blend(0.1_f32, 0.7, 0.0), blend(0.1_f32, 0.7, 1.0)),
            (0.1, 0.7)
        );
        assert_eq!(lerp(0.1_f32, 0.7, 0.0), 0.1);
    }

    #[test]
    fn bilinear_interpolates_between_four_values() {
        let four = [1.0_f64, 3.0, 5.0, 11.0];
        let corners = [
            ([0.0, 0.0], 1.0),
            ([1.0, 0.0], 3.0),
            ([0.0, 1.0], 5.0),
            ([1.0, 1.0], 11.0),
        ];
        for (share, expected) in corners {
            assert_eq!(bilinear(four, share), expected);
            let weighted: f64 = bilinear_weights(share)
                .iter()
                .zip(four)
                .map(|(w, v)| w * v)
                .sum();
            assert_eq!(weighted, expected);
        }
        assert_eq!(bilinear(four, [0.5, 0.5]), 5.0);
        assert_eq!(bilinear_weights([0.25_f32, 0.5]).iter().sum::<f32>(), 1.0);
    }
}

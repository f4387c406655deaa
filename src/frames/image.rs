//! Images and depth maps in memory; images made smaller.

use ostra_core::image::area_mean_rgb8;

/// A colour image, row by row from the top left, sRGB.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Image {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `width · height` pixels (red, green, blue).
    pub pixels: Vec<[u8; 3]>,
}

/// Depth along the optical axis, pixel for pixel with an image, in world units; 0 = unknown.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthMap {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `width · height` depths, row by row.
    pub depths: Vec<f32>,
}

impl Image {
    /// The pixel in column `x`, row `y`.
    #[must_use]
    #[inline]
    pub fn at(&self, x: u32, y: u32) -> [u8; 3] {
        self.pixels[(y * self.width + x) as usize]
    }

    /// Luma as in ITU-R BT.601, 0–1, pixel by pixel.
    #[must_use]
    #[inline]
    pub fn luma(&self) -> Vec<f32> {
        let luma = |&[r, g, b]: &[u8; 3]| {
            (0.299 * f32::from(r) + 0.587 * f32::from(g) + 0.114 * f32::from(b)) / 255.0
        };
        self.pixels.iter().map(luma).collect()
    }
}

impl DepthMap {
    /// The depth in column `x`, row `y`; 0 = unknown.
    #[must_use]
    #[inline]
    pub fn at(&self, x: u32, y: u32) -> f32 {
        self.depths[(y * self.width + x) as usize]
    }
}

/// Shrinks an image by averaging so that its longer side has at most `max_side` pixels; never enlarges.
pub(super) fn shrink(image: &Image, max_side: u32) -> Image {
    let longest = image.width.max(image.height).max(1);
    let max_side = max_side.clamp(1, longest);
    let side = |length: u32| {
        ((u64::from(length) * u64::from(max_side) / u64::from(longest)) as u32).max(1)
    };
    let (width, height) = (side(image.width), side(image.height));
    Image {
        width,
        height,
        pixels: area_mean_rgb8(&image.pixels, [image.width, image.height], [width, height]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_of_blocks_and_the_same_shape() {
        let pixels = (0..8 * 4)
            .map(|at| [if at % 8 < 4 { 10 } else { 200 }, at as u8, 7])
            .collect();
        let small = shrink(
            &Image {
                width: 8,
                height: 4,
                pixels,
            },
            2,
        );
        assert_eq!((small.width, small.height), (2, 1));
        assert_eq!(small.pixels, [[10, 14, 7], [200, 18, 7]]);
    }

    #[test]
    fn never_larger_and_never_nothing() {
        let line = Image {
            width: 300,
            height: 1,
            pixels: vec![[5; 3]; 300],
        };
        let small = shrink(&line, 7);
        assert_eq!((small.width, small.height, small.at(6, 0)), (7, 1, [5; 3]));
        assert_eq!(shrink(&line, 1000), line);
    }
}

//! Images and depth maps in memory, and shrinking of images.

use ostra_core::image::{ImageSize, area_mean_rgb8};

/// A colour image in sRGB, row by row from the top left.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Image {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `width · height` pixels (red, green, blue).
    pub pixels: Vec<[u8; 3]>,
}

/// Depth along the optical axis in world units, pixel for pixel with an image; 0 = unknown.
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
    /// Returns the width and height.
    #[must_use]
    pub fn size(&self) -> ImageSize {
        ImageSize::new(self.width as usize, self.height as usize)
    }

    /// Returns the pixel in column `x`, row `y`.
    #[must_use]
    #[inline]
    pub fn at(&self, x: u32, y: u32) -> [u8; 3] {
        self.pixels[(y * self.width + x) as usize]
    }

    /// Returns the ITU-R BT.601 luma of each pixel, 0–1.
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
    /// Returns the depth in column `x`, row `y`; 0 = unknown.
    #[must_use]
    #[inline]
    pub fn at(&self, x: u32, y: u32) -> f32 {
        self.depths[(y * self.width + x) as usize]
    }
}

/// Shrinks an image by averaging to at most `max_side` pixels on its longer side; never enlarges.
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
    fn shrinking_averages_blocks_and_keeps_the_shape() {
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
    fn shrinking_never_enlarges_and_never_gives_an_empty_image() {
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

//! Images and depth maps in memory; images made smaller.

/// A colour picture, row by row from the top left, sRGB.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Image {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `width · height` pixels (red, green, blue).
    pub pixels: Vec<[u8; 3]>,
}

/// Depth along the optical axis, pixel for pixel with a picture, in world units; 0 = unknown.
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

/// Shrinks a picture by averaging so that its longer side has at most `max_side` pixels; never enlarges.
pub(super) fn shrink(image: &Image, max_side: u32) -> Image {
    let longest = image.width.max(image.height).max(1);
    let max_side = max_side.clamp(1, longest);
    let side = |length: u32| {
        ((u64::from(length) * u64::from(max_side) / u64::from(longest)) as u32).max(1)
    };
    let (width, height) = (side(image.width), side(image.height));
    let mut pixels = Vec::with_capacity(width as usize * height as usize);
    let mut sums = vec![[0_u64; 3]; width as usize];
    for y in 0..height {
        sums.fill([0; 3]);
        let rows = span(y, height, image.height);
        for row in image
            .pixels
            .chunks_exact(image.width as usize)
            .skip(rows.start)
            .take(rows.len())
        {
            add_row(&mut sums, row);
        }
        for (x, sum) in (0..width).zip(&sums) {
            let count = (span(x, width, image.width).len() * rows.len()) as u64;
            pixels.push(sum.map(|channel| ((channel + count / 2) / count) as u8));
        }
    }
    Image {
        width,
        height,
        pixels,
    }
}

/// The source columns (or rows) that make target column `at` of `target`.
fn span(at: u32, target: u32, source: u32) -> std::ops::Range<usize> {
    let edge = |at: u32| (u64::from(at) * u64::from(source) / u64::from(target)) as usize;
    edge(at)..edge(at + 1)
}

fn add_row(sums: &mut [[u64; 3]], row: &[[u8; 3]]) {
    let (target, source) = (sums.len() as u32, row.len() as u32);
    for (x, sum) in (0..target).zip(sums) {
        for pixel in &row[span(x, target, source)] {
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

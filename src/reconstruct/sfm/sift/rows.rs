//! Rows of pixels with margins, and images made smaller.

use ostra_core::image::tent_shrink;

/// Samples kept on either side of each row, so that filters need no test for the border.
pub(super) const MARGIN: usize = 64;
/// Rows are padded to multiples of this, so that vector loops leave no remainder.
pub(super) const PAD: usize = 64;

/// A grey image, or the rows of it that are kept at a time: row `y` is stored at `y` modulo `held`.
#[derive(Debug, Clone)]
pub(super) struct Rows {
    /// Columns.
    pub width: usize,
    /// Rows of the whole image.
    pub height: usize,
    held: usize,
    stride: usize,
    samples: Vec<f32>,
}

impl Rows {
    /// Creates an image of zeros that keeps `held` rows at a time.
    pub fn new(width: usize, height: usize, held: usize) -> Self {
        let stride = width.next_multiple_of(PAD) + 2 * MARGIN + PAD;
        let held = held.clamp(1, height.max(1));
        Self {
            width,
            height,
            held,
            stride,
            samples: vec![0.0; stride * held],
        }
    }

    /// Creates a whole image.
    pub fn from_grey(grey: &[f32], width: usize, height: usize) -> Self {
        let mut rows = Self::new(width, height, height);
        if width > 0 {
            for (row, source) in rows
                .samples
                .chunks_exact_mut(rows.stride)
                .zip(grey.chunks_exact(width))
            {
                row[MARGIN..MARGIN + width].copy_from_slice(source);
                extend_margins(row, width);
            }
        }
        rows
    }

    /// Returns the number of samples from one row to the next.
    pub fn stride(&self) -> usize {
        self.stride
    }

    /// Returns row `y` without its margins.
    #[inline(always)]
    pub fn row(&self, y: usize) -> &[f32] {
        &self.with_margins(y)[MARGIN..MARGIN + self.width]
    }

    /// Returns row `y` with margins; the sample of column `x` is at `MARGIN + x`.
    #[inline(always)]
    pub fn with_margins(&self, y: usize) -> &[f32] {
        let start = (y % self.held) * self.stride;
        &self.samples[start..start + self.stride]
    }

    /// Returns row `y`, or the nearest existing one.
    #[inline(always)]
    pub fn nearest(&self, y: isize) -> &[f32] {
        self.with_margins(y.clamp(0, self.height as isize - 1) as usize)
    }

    /// Returns rows `first..last` with their margins for writing; they must be contiguous.
    pub fn piece_mut(&mut self, first: usize, last: usize) -> &mut [f32] {
        let start = (first % self.held) * self.stride;
        &mut self.samples[start..start + (last - first) * self.stride]
    }
}

/// Repeats the first and the last of a row's `width` samples in its margins.
#[inline(always)]
pub(super) fn extend_margins(row: &mut [f32], width: usize) {
    let (first, last) = (row[MARGIN], row[MARGIN + width - 1]);
    row[..MARGIN].fill(first);
    row[MARGIN + width..].fill(last);
}

/// Shrinks an image so that its longer side is at most `longest` pixels.
///
/// Also returns how many of the original's pixels one of its pixels spans in x and y.
pub(super) fn shrunk(
    grey: &[f32],
    width: usize,
    height: usize,
    longest: usize,
) -> (Rows, [f32; 2]) {
    let side = width.max(height);
    if side <= longest {
        return (Rows::from_grey(grey, width, height), [1.0; 2]);
    }
    let scaled = |size: usize| ((size * longest + side / 2) / side).max(1);
    let (narrow, low) = (scaled(width), scaled(height));
    let small = tent_shrink(grey, [width, height], [narrow, low]);
    (
        Rows::from_grey(&small, narrow, low),
        [width as f32 / narrow as f32, height as f32 / low as f32],
    )
}

//! Rows of pixels with margins, and images made smaller.

use std::sync::{Mutex, PoisonError};

use ostra_core::image::tent_shrink;

/// Samples kept on either side of each row, so that filters need no test for the border.
pub(super) const MARGIN: usize = 64;
/// Rows are padded to multiples of this, so that vector loops leave no remainder.
pub(super) const PAD: usize = 64;

/// Samples per cache line; rows are an odd number of lines apart, or those that a filter spans would
/// displace each other from the cache.
const LINE: usize = 16;

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

/// Buffers of images that are no longer needed, for the next ones.
///
/// Most of an extraction's memory is used again for the next image, because new memory costs about a
/// tenth of the time.
#[derive(Debug, Default)]
pub(super) struct SpareBuffers(Mutex<Vec<Vec<f32>>>);

/// Maximum number of spare buffers.
const MOST_SPARE: usize = 16;

impl SpareBuffers {
    /// Returns a buffer of `len` samples with any content.
    fn take(&self, len: usize) -> Vec<f32> {
        let mut spare = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let fitting = (0..spare.len()).filter(|&k| spare[k].capacity() >= len);
        let smallest = fitting.min_by_key(|&k| spare[k].capacity());
        let Some(found) = smallest else {
            return vec![0.0; len];
        };
        let mut buffer = spare.swap_remove(found);
        drop(spare);
        buffer.resize(len, 0.0);
        buffer
    }

    /// Frees all buffers.
    pub fn clear(&self) {
        let mut spare = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        *spare = Vec::new();
    }

    /// Keeps the buffer of an image.
    pub fn give(&self, rows: Rows) {
        let mut spare = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        spare.push(rows.samples);
        if spare.len() > MOST_SPARE {
            let smallest = (0..spare.len()).min_by_key(|&k| spare[k].capacity());
            smallest.map(|smallest| spare.swap_remove(smallest));
        }
    }
}

impl Rows {
    /// Creates an image with any content that keeps `held` rows at a time.
    pub fn new(width: usize, height: usize, held: usize, spare: &SpareBuffers) -> Self {
        let stride = width.next_multiple_of(PAD) + 2 * MARGIN + PAD + LINE;
        let held = held.clamp(1, height.max(1));
        Self {
            width,
            height,
            held,
            stride,
            samples: spare.take(stride * held),
        }
    }

    /// Creates a whole image.
    pub fn from_grey(grey: &[f32], width: usize, height: usize, spare: &SpareBuffers) -> Self {
        let mut rows = Self::new(width, height, height, spare);
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
    spare: &SpareBuffers,
) -> (Rows, [f32; 2]) {
    let side = width.max(height);
    if side <= longest {
        return (Rows::from_grey(grey, width, height, spare), [1.0; 2]);
    }
    let scaled = |size: usize| ((size * longest + side / 2) / side).max(1);
    let (narrow, low) = (scaled(width), scaled(height));
    let small = tent_shrink(grey, [width, height], [narrow, low]);
    (
        Rows::from_grey(&small, narrow, low, spare),
        [width as f32 / narrow as f32, height as f32 / low as f32],
    )
}

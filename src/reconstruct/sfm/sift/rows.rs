//! Rows of pixels with margins, and pictures made smaller.

/// Samples kept beside each row, so that filters need no test for the border.
pub(super) const MARGIN: usize = 64;
/// Rows are padded to multiples of this, so that vector loops leave no remainder.
pub(super) const PAD: usize = 64;

/// A grey picture, or the rows of it that are held at a time: row `y` lies at `y` modulo `held`.
#[derive(Debug, Clone)]
pub(super) struct Rows {
    /// Columns.
    pub width: usize,
    /// Rows of the whole picture.
    pub height: usize,
    held: usize,
    stride: usize,
    samples: Vec<f32>,
}

impl Rows {
    /// A picture of zeros that holds `held` rows at a time.
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

    /// A whole picture.
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

    /// Samples from one row to the next.
    pub fn stride(&self) -> usize {
        self.stride
    }

    /// Row `y` without its margins.
    #[inline(always)]
    pub fn row(&self, y: usize) -> &[f32] {
        &self.with_margins(y)[MARGIN..MARGIN + self.width]
    }

    /// Row `y`; the sample of column `x` is at `MARGIN + x`.
    #[inline(always)]
    pub fn with_margins(&self, y: usize) -> &[f32] {
        let start = (y % self.held) * self.stride;
        &self.samples[start..start + self.stride]
    }

    /// Row `y`, or the nearest one where there is none.
    #[inline(always)]
    pub fn nearest(&self, y: isize) -> &[f32] {
        self.with_margins(y.clamp(0, self.height as isize - 1) as usize)
    }

    /// Rows `first..last` with their margins, to be written; they must lie in one piece.
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

/// A picture whose longer side is at most `longest` pixels, and how many of the original's pixels one of its pixels
/// spans in x and y.
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
    let across = weights(width, narrow);
    let rows: Vec<f32> = grey
        .chunks_exact(width)
        .flat_map(|row| across.iter().map(|w| w.of(row, 1)))
        .collect();
    let down = weights(height, low);
    let pixels = down
        .iter()
        .flat_map(|w| (0..narrow).map(|x| w.of(&rows[x..], narrow)));
    let small: Vec<f32> = pixels.collect();
    (
        Rows::from_grey(&small, narrow, low),
        [width as f32 / narrow as f32, height as f32 / low as f32],
    )
}

/// Weights of the samples from `first` on that make one sample of a smaller row.
struct Weights {
    first: usize,
    values: Vec<f32>,
}

impl Weights {
    fn of(&self, samples: &[f32], step: usize) -> f32 {
        let from = samples[self.first * step..].iter().step_by(step);
        from.zip(&self.values)
            .map(|(sample, weight)| sample * weight)
            .sum()
    }
}

/// Tent filters as wide as two of the smaller row's samples, so that nothing finer is left to alias.
fn weights(from: usize, to: usize) -> Vec<Weights> {
    let ratio = from as f32 / to as f32;
    let one = |k: usize| {
        let centre = (k as f32 + 0.5) * ratio - 0.5;
        let first = (centre - ratio).ceil().max(0.0) as usize;
        let last = ((centre + ratio).floor() as usize).min(from - 1);
        let tent = |at: usize| (1.0 - (at as f32 - centre).abs() / ratio).max(0.0);
        let sum: f32 = (first..=last).map(tent).sum();
        Weights {
            first,
            values: (first..=last).map(|at| tent(at) / sum).collect(),
        }
    };
    (0..to).map(one).collect()
}

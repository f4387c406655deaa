/// A grey picture, values 0–255, row by row.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Grey {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width · height` values.
    pub values: Vec<f32>,
}

impl Grey {
    /// The picture of half the size, each pixel the mean of four; an odd last row or column is left off.
    pub fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let at = |x: usize, y: usize| self.values[y * self.width + x];
        let mean = |x: usize, y: usize| 0.25 * (at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1));
        let values = (0..height).flat_map(|y| (0..width).map(move |x| mean(2 * x, 2 * y))).collect();
        Self { width, height, values }
    }

    /// Whether no two pixels differ by more than rounding.
    pub fn is_constant(&self) -> bool {
        let (low, high) = self.values.iter().fold((f32::MAX, f32::MIN), |(l, h), &v| (l.min(v), h.max(v)));
        self.values.is_empty() || high - low < 2.0
    }
}

/// A picture made ready for bilinear sampling: each element holds four neighbouring greys, so that a sample is one load.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Texture {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Greys 0–255 of (x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1), from the lowest byte on.
    pub quads: Vec<u32>,
}

impl Texture {
    /// The texture of a picture, greys rounded to 8 bits.
    pub fn new(grey: &Grey) -> Self {
        let (width, height) = (grey.width, grey.height);
        let bytes: Vec<u8> = grey.values.iter().map(|&value| (value + 0.5) as u8).collect();
        let mut quads = Vec::with_capacity(bytes.len());
        for y in 0..height {
            let rows = [y * width, (y + 1).min(height - 1) * width];
            for x in 0..width {
                let next = (x + 1).min(width - 1);
                let quad = [bytes[rows[0] + x], bytes[rows[0] + next], bytes[rows[1] + x], bytes[rows[1] + next]];
                quads.push(u32::from_le_bytes(quad));
            }
        }
        Self { width, height, quads }
    }

    /// The grey of a pixel.
    #[inline(always)]
    pub fn grey(&self, x: usize, y: usize) -> u8 {
        self.quads[y * self.width + x] as u8
    }
}

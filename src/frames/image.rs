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
    pub fn at(&self, x: u32, y: u32) -> [u8; 3] {
        self.pixels[(y * self.width + x) as usize]
    }

    /// Luma as in ITU-R BT.601, 0–1, pixel by pixel.
    #[must_use]
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
    pub fn at(&self, x: u32, y: u32) -> f32 {
        self.depths[(y * self.width + x) as usize]
    }
}

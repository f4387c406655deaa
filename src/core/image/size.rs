/// Width and height of an image, in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ImageSize {
    /// Number of columns.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
}

impl ImageSize {
    /// Creates a size from its columns and rows.
    #[must_use]
    pub const fn new(width: usize, height: usize) -> Self {
        Self { width, height }
    }

    /// Returns the number of pixels.
    #[must_use]
    pub const fn area(self) -> usize {
        self.width * self.height
    }

    /// Returns the size with each side changed by a function.
    #[must_use]
    pub fn map(self, change: impl Fn(usize) -> usize) -> Self {
        Self {
            width: change(self.width),
            height: change(self.height),
        }
    }
}

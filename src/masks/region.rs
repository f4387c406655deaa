use super::MaskError;

/// The pixels of one object on one frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Region {
    /// Number of columns.
    pub width: u32,
    /// Number of rows.
    pub height: u32,
    /// Whether each pixel is inside: `width · height` flags, row by row.
    pub inside: Vec<bool>,
}

impl Region {
    /// Returns a region without pixels.
    #[must_use]
    #[inline]
    pub fn empty(width: u32, height: u32) -> Self {
        Self {
            width,
            height,
            inside: vec![false; width as usize * height as usize],
        }
    }

    /// Returns whether the pixel in column `x`, row `y` is inside.
    #[must_use]
    #[inline]
    pub fn at(&self, x: u32, y: u32) -> bool {
        self.inside[y as usize * self.width as usize + x as usize]
    }

    /// Returns the number of pixels inside.
    #[must_use]
    #[inline]
    pub fn area(&self) -> usize {
        self.inside.iter().filter(|&&inside| inside).count()
    }

    /// Returns whether no pixel is inside.
    #[must_use]
    #[inline]
    pub fn is_empty(&self) -> bool {
        !self.inside.contains(&true)
    }

    /// Adds the pixels of `other`, a region of the same frame.
    #[inline]
    pub fn unite(&mut self, other: &Self) {
        self.combine(other, |a, b| a | b);
    }

    /// Keeps only the pixels that are also in `other`, a region of the same frame.
    #[inline]
    pub fn intersect(&mut self, other: &Self) {
        self.combine(other, |a, b| a & b);
    }

    /// Removes the pixels of `other`, a region of the same frame.
    #[inline]
    pub fn subtract(&mut self, other: &Self) {
        self.combine(other, |a, b| a & !b);
    }

    /// Keeps the pixels that are in only one of the two; `other` is a region of the same frame.
    #[inline]
    pub fn differ(&mut self, other: &Self) {
        self.combine(other, |a, b| a ^ b);
    }

    /// Returns the pixels outside.
    #[must_use]
    #[inline]
    pub fn inverted(&self) -> Self {
        Self {
            width: self.width,
            height: self.height,
            inside: self.inside.iter().map(|&inside| !inside).collect(),
        }
    }

    /// Returns the intersection over union with a region of the same frame; 1 if both are empty.
    #[must_use]
    pub fn iou(&self, other: &Self) -> f64 {
        debug_assert_eq!(
            (self.width, self.height),
            (other.width, other.height),
            "regions of one frame"
        );
        let (mut common, mut either) = (0usize, 0usize);
        for (&a, &b) in self.inside.iter().zip(&other.inside) {
            common += usize::from(a & b);
            either += usize::from(a | b);
        }
        if either == 0 {
            1.0
        } else {
            common as f64 / either as f64
        }
    }

    /// Returns an error unless the region has this size.
    pub(super) fn check_size(&self, width: u32, height: u32) -> Result<(), MaskError> {
        if (self.width, self.height) == (width, height) {
            return Ok(());
        }
        Err(MaskError::Request(format!(
            "an answer of {}×{} pixels does not fit a frame of {width}×{height}; segment the frame again",
            self.width, self.height
        )))
    }

    fn combine(&mut self, other: &Self, join: impl Fn(bool, bool) -> bool) {
        debug_assert_eq!(
            (self.width, self.height),
            (other.width, other.height),
            "regions of one frame"
        );
        for (a, &b) in self.inside.iter_mut().zip(&other.inside) {
            *a = join(*a, b);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boolean_operations_work_per_pixel() {
        let a = Region {
            width: 4,
            height: 1,
            inside: vec![true, true, false, false],
        };
        let b = Region {
            width: 4,
            height: 1,
            inside: vec![true, false, true, false],
        };
        let after = |operation: fn(&mut Region, &Region)| {
            let mut region = a.clone();
            operation(&mut region, &b);
            region.inside
        };
        assert_eq!(after(Region::unite), [true, true, true, false]);
        assert_eq!(after(Region::intersect), [true, false, false, false]);
        assert_eq!(after(Region::subtract), [false, true, false, false]);
        assert_eq!(after(Region::differ), [false, true, true, false]);
        assert_eq!(a.inverted().inside, [false, false, true, true]);
        assert!((a.iou(&b) - 1.0 / 3.0).abs() < 1e-12);
        assert!((Region::empty(4, 1).iou(&Region::empty(4, 1)) - 1.0).abs() < 1e-12);
        assert!(Region::empty(4, 1).is_empty() && !a.is_empty());
    }
}

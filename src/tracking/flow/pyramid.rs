use super::plane::Plane;

/// Pixels added around a level, so that a patch partly outside reads the nearest border pixels.
pub(super) const PAD: usize = 16;

/// A grey picture, 0–255, with its border repeated around it.
pub(super) struct Level {
    pub width: usize,
    pub height: usize,
    /// Pixels from one row to the next of `padded`.
    pub stride: usize,
    pub padded: Vec<f32>,
}

/// A grey picture at full, half, quarter … size.
pub(super) struct Pyramid {
    pub levels: Vec<Level>,
}

impl Pyramid {
    /// Down to the last level whose shorter side is at least `least_side`; the first is always there.
    pub fn new(grey: Plane, least_side: usize) -> Self {
        let mut planes = vec![grey];
        while let Some(last) = planes.last()
            && last.width.min(last.height) / 2 >= least_side
        {
            planes.push(halved(last));
        }
        Self {
            levels: planes.iter().map(Level::new).collect(),
        }
    }
}

impl Level {
    /// The grey levels without the border around them, row by row.
    pub fn pixels(&self) -> impl Iterator<Item = f32> {
        let row = |y: usize| &self.padded[(y + PAD) * self.stride + PAD..][..self.width];
        (0..self.height).flat_map(move |y| row(y).iter().copied())
    }

    fn new(plane: &Plane) -> Self {
        let (width, height) = (plane.width, plane.height);
        let stride = width + 2 * PAD;
        let mut padded = Vec::with_capacity(stride * (height + 2 * PAD));
        for y in 0..height + 2 * PAD {
            let row = y.saturating_sub(PAD).min(height - 1) * width;
            let row = &plane.values[row..row + width];
            padded.extend(std::iter::repeat_n(row[0], PAD));
            padded.extend_from_slice(row);
            padded.extend(std::iter::repeat_n(row[width - 1], PAD));
        }
        Self {
            width,
            height,
            stride,
            padded,
        }
    }

    /// Place in `padded` of a pixel up to `PAD` outside the picture.
    pub fn place(&self, x: isize, y: isize) -> usize {
        ((y + PAD as isize) * self.stride as isize + x + PAD as isize) as usize
    }

    pub fn at(&self, x: isize, y: isize) -> f32 {
        self.padded[self.place(x, y)]
    }
}

fn halved(plane: &Plane) -> Plane {
    let (width, height) = (plane.width / 2, plane.height / 2);
    Plane::from_fn(width, height, |x, y| {
        let at = 2 * y * plane.width + 2 * x;
        let v = &plane.values;
        (v[at] + v[at + 1] + v[at + plane.width] + v[at + plane.width + 1]) / 4.0
    })
}

use glam::{Affine2, Vec2};
use rayon::prelude::*;

use ostra_core::image::{Corners, blend, halve_row, mean_of_four};
use ostra_core::statistics::upper_median;

/// One `f32` per pixel, row by row.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Plane {
    pub width: usize,
    pub height: usize,
    pub values: Vec<f32>,
}

/// Displacement of each pixel to its match in another image, in pixels.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Flow {
    pub width: usize,
    pub height: usize,
    pub vectors: Vec<Vec2>,
}

impl Plane {
    pub fn new(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            values: vec![0.0; width * height],
        }
    }

    /// Creates a plane that is 1 inside the mask and 0 outside.
    pub fn of_mask(width: usize, height: usize, mask: &[bool]) -> Self {
        Self {
            width,
            height,
            values: mask
                .iter()
                .map(|&inside| f32::from(u8::from(inside)))
                .collect(),
        }
    }

    /// Computes each pixel by a function, rows in parallel.
    pub fn from_fn(
        width: usize,
        height: usize,
        value: impl Fn(usize, usize) -> f32 + Sync,
    ) -> Self {
        let mut plane = Self::new(width, height);
        let rows = plane.values.par_chunks_exact_mut(width).enumerate();
        rows.for_each(|(y, row)| {
            row.iter_mut()
                .enumerate()
                .for_each(|(x, out)| *out = value(x, y));
        });
        plane
    }

    /// Interpolates bilinearly; beyond the border, the nearest pixel counts.
    #[inline]
    pub fn sample(&self, at: Vec2) -> f32 {
        let (corner, weights) = corners(at, self.width, self.height);
        corner
            .iter()
            .zip(weights)
            .map(|(&corner, weight)| self.values[corner] * weight)
            .sum()
    }

    /// Warps the plane by a flow: each pixel samples it at the end of its vector.
    pub fn pulled(&self, flow: &Flow) -> Self {
        Self::from_fn(flow.width, flow.height, |x, y| {
            self.sample(Vec2::new(x as f32, y as f32) + flow.vectors[y * flow.width + x])
        })
    }

    /// Transforms the plane by `motion`; areas from beyond the border are 0.
    pub fn moved(&self, motion: Affine2) -> Self {
        let back = motion.inverse();
        Self::from_fn(self.width, self.height, |x, y| {
            let at = back.transform_point2(Vec2::new(x as f32, y as f32));
            if self.holds(at) { self.sample(at) } else { 0.0 }
        })
    }

    fn holds(&self, at: Vec2) -> bool {
        at.x > -0.5
            && at.y > -0.5
            && at.x < self.width as f32 - 0.5
            && at.y < self.height as f32 - 0.5
    }
}

impl Flow {
    /// Interpolates bilinearly; beyond the border, the nearest pixel counts.
    #[inline]
    pub fn sample(&self, at: Vec2) -> Vec2 {
        let (corner, weights) = corners(at, self.width, self.height);
        corner
            .iter()
            .zip(weights)
            .map(|(&corner, weight)| self.vectors[corner] * weight)
            .sum()
    }

    pub fn at(&self, x: usize, y: usize) -> Vec2 {
        self.vectors[y * self.width + x]
    }

    /// Resizes the flow; the vectors are scaled as well.
    pub fn resized(&self, width: usize, height: usize) -> Self {
        let scale = Vec2::new(
            self.width as f32 / width as f32,
            self.height as f32 / height as f32,
        );
        let vector = |at: usize| {
            let centre = Vec2::new((at % width) as f32 + 0.5, (at / width) as f32 + 0.5);
            self.sample(centre * scale - 0.5) / scale
        };
        Self {
            width,
            height,
            vectors: (0..width * height)
                .into_par_iter()
                .with_min_len(4096)
                .map(vector)
                .collect(),
        }
    }
}

/// Returns the four pixels around a position and their weights.
#[inline(always)]
pub(super) fn corners(at: Vec2, width: usize, height: usize) -> ([usize; 4], [f32; 4]) {
    let Corners { pixels, weights } = Corners::around(at.to_array(), width, height);
    (pixels, weights)
}

/// Padding around a level, so that patches partly outside read the nearest border pixels.
pub(super) const PAD: usize = 16;

/// A grey image, 0–255, padded with its border pixels.
pub(super) struct Level {
    pub width: usize,
    pub height: usize,
    /// Distance between rows of `padded`, in pixels.
    pub stride: usize,
    pub padded: Vec<f32>,
}

/// A grey image at full, half, quarter … size.
pub(super) struct Pyramid {
    pub levels: Vec<Level>,
}

impl Pyramid {
    /// Builds levels while the shorter side is at least `least_side`; the first always exists.
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
    /// Returns the grey levels without the padding, row by row.
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

    /// Returns the index in `padded` of a pixel up to `PAD` outside the image.
    pub fn place(&self, x: isize, y: isize) -> usize {
        ((y + PAD as isize) * self.stride as isize + x + PAD as isize) as usize
    }

    pub fn at(&self, x: isize, y: isize) -> f32 {
        self.padded[self.place(x, y)]
    }
}

fn halved(plane: &Plane) -> Plane {
    let (width, height) = (plane.width / 2, plane.height / 2);
    let mut half = Plane::new(width, height);
    let rows = half.values.par_chunks_exact_mut(width).enumerate();
    rows.for_each(|(y, row)| {
        let (upper, lower) = plane.values[2 * y * plane.width..].split_at(plane.width);
        let means = halve_row(upper, &lower[..plane.width], mean_of_four);
        row.iter_mut()
            .zip(means)
            .for_each(|(out, mean)| *out = mean);
    });
    half
}

/// Interpolates the second image where a pixel of the first lies after its displacement.
pub(super) fn interpolated(level: &Level, x: usize, y: usize, displacement: Vec2) -> f32 {
    let x = (x as f32 + displacement.x).clamp(-1.0, level.width as f32);
    let y = (y as f32 + displacement.y).clamp(-1.0, level.height as f32);
    let (left, top) = (x.floor(), y.floor());
    let (u, v) = (x - left, y - top);
    let at = level.place(left as isize, top as isize);
    let row = |at: usize| blend(level.padded[at], level.padded[at + 1], u);
    blend(row(at), row(at + level.stride), v)
}

/// Returns the upper median; 0 if there are no values.
pub(super) fn median(values: impl Iterator<Item = f32>) -> f32 {
    let mut values: Vec<f32> = values.collect();
    upper_median(&mut values).unwrap_or(0.0)
}

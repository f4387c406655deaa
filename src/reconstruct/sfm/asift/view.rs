//! Simulated tilted views of an image, and the features found in them.

use std::f64::consts::TAU;

use glam::{DMat2, DVec2};
use rayon::prelude::*;

use crate::sfm::{FeatureError, FeatureExtractor, Features};
use ostra_core::image::{blend, block_means};

/// A direction in an image and the compression along it.
///
/// The image is compressed as if seen at an angle whose cosine is 1 / `by`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tilt {
    /// Angle of the direction with the rows, in radians.
    pub along: f64,
    /// At least 1.
    pub by: f64,
}

/// Simulated tilts: powers of √2.
const TILTS: [f64; 3] = [
    std::f64::consts::SQRT_2,
    2.0,
    2.0 * std::f64::consts::SQRT_2,
];
/// Angle between directions at a tilt of 1, in radians; smaller at larger tilts.
const STEP: f64 = 1.256_637_061_435_917_3;
/// Blur before compression, per √(tilt² − 1), in pixels; SIFT assumes that an image already has half a pixel of blur.
const BLUR: f64 = 0.8;
/// The kernel ends after this many standard deviations.
const KERNEL_REACH: f64 = 3.0;

impl Tilt {
    /// Returns tilts such that every other one up to the largest is near one of them.
    ///
    /// J.-M. Morel, G. Yu, *ASIFT: A New Framework for Fully Affine Invariant Image Comparison*,
    /// SIAM J. Imaging Sciences 2009.
    pub fn all() -> Vec<Self> {
        let of = |by: f64| {
            let count = (std::f64::consts::PI * by / STEP).round();
            (0..count as u32).map(move |i| Self {
                along: f64::from(i) * std::f64::consts::PI / count,
                by,
            })
        };
        TILTS.into_iter().flat_map(of).collect()
    }
}

/// A simulated tilted view of an image.
#[derive(Debug, Clone, PartialEq)]
pub struct TiltedView {
    /// Grey values in 0–1, row by row.
    pub grey: Vec<f32>,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Position of the view's pixels in the image: `original_from_view · x + origin`.
    original_from_view: DMat2,
    origin: DVec2,
    size: DVec2,
}

impl TiltedView {
    /// Creates a view of a grey image in 0–1, row by row.
    ///
    /// Beyond the edge the edge is repeated. Images with a side longer than `max_side` are shrunk.
    pub fn new(grey: &[f32], [width, height]: [usize; 2], tilt: Tilt, max_side: usize) -> Self {
        let step = width.max(height).div_ceil(max_side).max(1);
        if step == 1 {
            return Self::of_small(grey, width, height, tilt);
        }
        let small = Self::of_small(
            &block_means(grey, width, step),
            width / step,
            height / step,
            tilt,
        );
        Self {
            original_from_view: small.original_from_view * step as f64,
            origin: small.origin * step as f64,
            size: small.size * step as f64,
            ..small
        }
    }

    fn of_small(grey: &[f32], width: usize, height: usize, tilt: Tilt) -> Self {
        let size = DVec2::new(width as f64, height as f64);
        let turn = DMat2::from_angle(tilt.along);
        let corners = [
            DVec2::ZERO,
            DVec2::new(size.x, 0.0),
            DVec2::new(0.0, size.y),
            size,
        ];
        let corners = corners.map(|corner| turn.transpose() * corner);
        let low = corners.into_iter().fold(corners[0], DVec2::min);
        let high = corners.into_iter().fold(corners[0], DVec2::max);
        let extent = (high - low).ceil().max(DVec2::ONE);
        let (wide, rows) = (extent.x as usize, extent.y as usize);
        let columns = ((extent.x / tilt.by) as usize).max(1);
        let kernel = kernel(BLUR * (tilt.by * tilt.by - 1.0).max(0.0).sqrt());
        let mut view = vec![0.0; columns * rows];
        view.par_chunks_mut(columns)
            .enumerate()
            .for_each(|(y, row)| {
                let at = |x: usize| turn * (low + DVec2::new(x as f64, y as f64) + 0.5);
                let line: Vec<f32> = (0..wide)
                    .map(|x| between(grey, [width, height], at(x)))
                    .collect();
                for (x, value) in row.iter_mut().enumerate() {
                    *value = blurred(&line, &kernel, (x as f64 + 0.5) * tilt.by - 0.5);
                }
            });
        let original_from_view = turn * DMat2::from_diagonal(DVec2::new(tilt.by, 1.0));
        Self {
            grey: view,
            width: columns,
            height: rows,
            original_from_view,
            origin: turn * low,
            size,
        }
    }

    /// Returns the position in the image of a position in the view, both in pixels.
    pub fn original(&self, at_px: DVec2) -> DVec2 {
        self.original_from_view * at_px + self.origin
    }

    /// Returns the direction in the image of a direction in the view, both in radians, 0–2π.
    fn original_direction(&self, angle: f32) -> f32 {
        let along = self.original_from_view * DVec2::from_angle(f64::from(angle));
        along.to_angle().rem_euclid(TAU) as f32
    }

    /// Returns whether a position in the view lies in the image.
    pub fn shows(&self, at_px: DVec2) -> bool {
        let at = self.original(at_px);
        at.cmpge(DVec2::ZERO).all() && at.cmplt(self.size).all()
    }
}

/// Returns half of a symmetric kernel of sum 1, from its middle on.
fn kernel(sigma: f64) -> Vec<f32> {
    if sigma <= 0.0 {
        return vec![1.0];
    }
    let reach = (KERNEL_REACH * sigma).ceil() as u32;
    let half: Vec<f64> = (0..=reach)
        .map(|i| (-0.5 * (f64::from(i) / sigma).powi(2)).exp())
        .collect();
    let sum = 2.0 * half.iter().sum::<f64>() - half[0];
    half.iter().map(|value| (value / sum) as f32).collect()
}

/// Returns a blurred line at a position between two samples.
fn blurred(line: &[f32], kernel: &[f32], at: f64) -> f32 {
    let last = line.len() as isize - 1;
    let value = |x: isize| line[x.clamp(0, last) as usize];
    let sum = |x: isize| {
        let sides = kernel.iter().enumerate().skip(1);
        let around =
            sides.map(|(i, weight)| weight * (value(x - i as isize) + value(x + i as isize)));
        kernel[0] * value(x) + around.sum::<f32>()
    };
    let (before, share) = (at.floor() as isize, at.fract() as f32);
    blend(sum(before), sum(before + 1), share)
}

/// Interpolates the image between four pixels.
fn between(grey: &[f32], [width, height]: [usize; 2], at: DVec2) -> f32 {
    let limit = |at: f64, side: usize| (at - 0.5).clamp(0.0, (side - 1) as f64);
    let (x, y) = (limit(at.x, width), limit(at.y, height));
    let (left, top) = (x as usize, y as usize);
    let (right, low) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
    let (across, down) = (x.fract() as f32, y.fract() as f32);
    let row = |y: usize| (1.0 - across) * grey[y * width + left] + across * grey[y * width + right];
    (1.0 - down) * row(top) + down * row(low)
}

/// An image of which tilted views are made.
#[derive(Clone, Copy)]
pub struct Original<'a> {
    /// Grey values in 0–1, row by row.
    pub grey: &'a [f32],
    /// Columns and rows.
    pub size: [usize; 2],
    /// Pixels where features may lie; `None` = all.
    pub allowed: Option<&'a [bool]>,
}

/// Extracts features of an image under a simulated tilt, at their positions in the image itself.
///
/// The image is first shrunk so that its longer side is at most `max_side` pixels.
///
/// # Errors
/// Fails if the extractor fails.
pub fn tilted_features(
    extractor: &dyn FeatureExtractor,
    original: Original<'_>,
    tilt: Tilt,
    max_side: usize,
) -> Result<Features, FeatureError> {
    let Original {
        grey,
        size: [width, height],
        allowed,
    } = original;
    let view = TiltedView::new(grey, [width, height], tilt, max_side);
    let found = extractor.extract(
        &view.grey,
        view.width,
        view.height,
        Some(&allowed_in(&view, width, allowed)),
    )?;
    Ok(Features {
        width: width as u32,
        height: height as u32,
        keypoints: found
            .keypoints
            .iter()
            .map(|&at_px| view.original(at_px))
            .collect(),
        orientations: found
            .orientations
            .iter()
            .map(|&angle| view.original_direction(angle))
            .collect(),
        ..found
    })
}

/// Returns which pixels of a view show an allowed one of the image.
fn allowed_in(view: &TiltedView, width: usize, allowed: Option<&[bool]>) -> Vec<bool> {
    let pixels = (0..view.height)
        .into_par_iter()
        .flat_map_iter(|y| (0..view.width).map(move |x| DVec2::new(x as f64, y as f64) + 0.5));
    let is_allowed =
        |at: DVec2| allowed.is_none_or(|allowed| allowed[at.y as usize * width + at.x as usize]);
    pixels
        .map(|at_px| view.shows(at_px) && is_allowed(view.original(at_px)))
        .collect()
}

//! SIFT of a whole image as a feature extractor, without features at black borders.

use glam::Vec2;

use super::descriptor::SUPPORT;
use super::keypoint::{SiftFeatures, SiftKeypoint, SiftOptions, Strongest};
use super::octave::{Octave, bases, level_sigma};
use super::refine::Extremum;
use super::rows::{SpareBuffers, shrunk};
use crate::sfm::{Descriptors, FeatureError, FeatureExtractor, Features};

/// Extracts SIFT features of a grey image (`width · height` values in 0–1, row by row).
///
/// Features lie only where `mask` (one value per pixel) is true, or anywhere without it. Features
/// whose surroundings touch a near-black bar at a side of the image are dropped. Above
/// `max_features` the strongest are kept. The result is empty if the lengths do not fit the size or
/// the options are out of range. Runs on rayon's threads; the result does not depend on their
/// number.
///
/// D. Lowe, "Distinctive Image Features from Scale-Invariant Keypoints", IJCV 2004.
#[must_use]
pub fn extract_sift(
    grey: &[f32],
    width: usize,
    height: usize,
    mask: Option<&[bool]>,
    options: &SiftOptions,
) -> SiftFeatures {
    extract(
        grey,
        [width, height],
        mask,
        options,
        &SpareBuffers::default(),
    )
}

fn extract(
    grey: &[f32],
    [width, height]: [usize; 2],
    mask: Option<&[bool]>,
    options: &SiftOptions,
    spare: &SpareBuffers,
) -> SiftFeatures {
    let fits = grey.len() == width * height && mask.is_none_or(|mask| mask.len() == grey.len());
    if !fits || width.min(height) < SMALLEST_SIDE || !(1..=8).contains(&options.scales) {
        return SiftFeatures::default();
    }
    let (image, pixel_size) = shrunk(grey, width, height, options.max_side as usize, spare);
    let content = Content::of(grey, width, height);
    let allowed = |keypoint: &SiftKeypoint| {
        let [x, y] = [keypoint.at_px.x as usize, keypoint.at_px.y as usize];
        let pixel = y.min(height - 1) * width + x.min(width - 1);
        mask.is_none_or(|mask| mask[pixel])
            && content.holds(keypoint.at_px, SUPPORT * keypoint.scale_px)
    };
    let mut strongest = Strongest::new(options.max_features);
    let mut find = |octave: Octave, index: i32| {
        let keypoint = |extremum: &Extremum| {
            Some(keypoint(extremum, index, pixel_size, options)).filter(allowed)
        };
        octave.find(&keypoint, &mut strongest);
    };
    let coarser = bases(&image, options, spare)
        .into_iter()
        .enumerate()
        .skip(options.first_octave.max(0) as usize);
    for (octave, base) in coarser.rev() {
        find(Octave::of(base, options, spare), octave as i32);
    }
    if options.first_octave < 0 {
        find(Octave::doubled(&image, options, spare), -1);
    }
    spare.give(image);
    strongest.into_features()
}

/// Images with a shorter side below this, in pixels, get no features.
const SMALLEST_SIDE: usize = 16;

/// Converts to a keypoint in pixels of the original image, without angle.
///
/// One processed pixel spans `width` by `height` pixels of the original.
fn keypoint(
    extremum: &Extremum,
    octave: i32,
    [width, height]: [f32; 2],
    options: &SiftOptions,
) -> SiftKeypoint {
    let step = (octave as f32).exp2();
    SiftKeypoint {
        at_px: Vec2::new(
            (extremum.x * step + 0.5) * width,
            (extremum.y * step + 0.5) * height,
        ),
        scale_px: level_sigma(extremum.scale, options.scales) * step * (width * height).sqrt(),
        angle: 0.0,
    }
}

/// SIFT with L1-root descriptors; needs no network weights.
///
/// It is the most accurate extractor on the sets with ground truth, and therefore the choice of
/// `auto`. Learned features are for images in which it finds too little.
#[derive(Debug, Default)]
pub struct Sift {
    options: SiftOptions,
    spare: SpareBuffers,
}

impl Sift {
    /// Creates an extractor with the options.
    #[must_use]
    pub fn new(options: SiftOptions) -> Self {
        Self {
            options,
            spare: SpareBuffers::default(),
        }
    }
}

impl FeatureExtractor for Sift {
    fn name(&self) -> &'static str {
        "sift"
    }

    fn free_buffers(&self) {
        self.spare.clear();
    }

    fn extract(
        &self,
        grey: &[f32],
        width: usize,
        height: usize,
        allowed: Option<&[bool]>,
    ) -> Result<Features, FeatureError> {
        let size = [width, height];
        // Inside the pool, starting each of the many parallel loops costs less than from outside.
        let found = rayon::scope(|_| extract(grey, size, allowed, &self.options, &self.spare));
        Ok(Features {
            width: width as u32,
            height: height as u32,
            keypoints: found
                .keypoints
                .iter()
                .map(|keypoint| keypoint.at_px.as_dvec2())
                .collect(),
            scales_px: found
                .keypoints
                .iter()
                .map(|keypoint| keypoint.scale_px)
                .collect(),
            orientations: found
                .keypoints
                .iter()
                .map(|keypoint| keypoint.angle)
                .collect(),
            scores: Vec::new(),
            descriptors: Descriptors::Bytes {
                dim: 128,
                values: found.descriptors.into_flattened(),
            },
        })
    }
}

/// Brightest line that a bar may begin with, in grey.
const DARKEST: f32 = 20.0 / 255.0;
/// Largest difference of a bar's pixel from the bar's grey: compression leaves artefacts next to the edge.
const SPREAD: f32 = 8.0 / 255.0;
/// Minimum number of lines of a bar; anything narrower is an image's dark rim.
const NARROWEST: usize = 4;
/// Lines beyond the edge that are examined to distinguish a bar from a dark background.
const BEYOND: usize = 4;
/// Minimum share of these pixels that must differ from the bar, because a bar ends everywhere at once.
const LEAST_CONTENT: f32 = 0.5;

/// The part of an image inside near-black bars at its sides.
///
/// Features whose surroundings touch the bars would stay fixed while the scene moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Content {
    /// First and past-the-last column; infinite where there is no bar.
    pub columns: (f32, f32),
    /// First and past-the-last row.
    pub rows: (f32, f32),
}

impl Content {
    /// Finds the bars of a grey image.
    pub fn of(grey: &[f32], width: usize, height: usize) -> Self {
        let [columns, rows] = [(width, height, 1, width), (height, width, width, 1)].map(
            |(lines, len, step, along)| {
                let bar = |line: &dyn Fn(usize) -> usize| {
                    bar(lines, len, &|k, at| grey[line(k) * step + at * along])
                };
                let (before, after) = (bar(&|k| k), bar(&|k| lines - 1 - k));
                let first = if before > 0 {
                    before as f32
                } else {
                    f32::NEG_INFINITY
                };
                (
                    first,
                    if after > 0 {
                        (lines - after) as f32
                    } else {
                        f32::INFINITY
                    },
                )
            },
        );
        Self { columns, rows }
    }

    /// Returns whether a disc lies inside.
    pub fn holds(&self, at: glam::Vec2, radius: f32) -> bool {
        let inside =
            |at: f32, (first, last): (f32, f32)| at - radius >= first && at + radius <= last;
        inside(at.x, self.columns) && inside(at.y, self.rows)
    }
}

/// Returns how many lines the bar has that begins at line 0 of `lines` lines of `len` pixels; 0 = no bar.
fn bar(lines: usize, len: usize, pixel: &dyn Fn(usize, usize) -> f32) -> usize {
    if lines == 0 || len == 0 {
        return 0;
    }
    let mean = (0..len).map(|at| pixel(0, at)).sum::<f32>() / len as f32;
    let belongs = |line: usize| (0..len).all(|at| (pixel(line, at) - mean).abs() <= SPREAD);
    let count = (0..lines)
        .take_while(|&line| mean <= DARKEST && belongs(line))
        .count();
    if count < NARROWEST || count == lines {
        return 0;
    }
    let beyond = (count + BEYOND).min(lines - 1);
    let content = (0..len)
        .filter(|&at| (pixel(beyond, at) - mean).abs() > SPREAD)
        .count();
    if content as f32 >= LEAST_CONTENT * len as f32 {
        count
    } else {
        0
    }
}

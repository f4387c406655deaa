//! Images in the form that networks take, keypoints in the form that they give, and the first pass
//! that matchers share.

use std::path::Path;

use glam::DVec2;
use image::imageops::{FilterType, resize};
use image::{ImageBuffer, Luma};

use crate::sfm::sift::Content;
use crate::sfm::{Descriptors, FeatureError, Features};
use ostra_compute::nn::{Network, NnError, Tensor, load};
use ostra_core::image::ImageSize;

/// An image as a network takes it.
///
/// Large images are shrunk. The last column and row are repeated up to a multiple that the network
/// requires.
#[derive(Debug, Clone, PartialEq)]
pub struct PreparedImage {
    /// Grey values row by row, 0–1.
    pub grey: Vec<f32>,
    /// Columns, including the repeated ones.
    pub width: usize,
    /// Rows, including the repeated ones.
    pub height: usize,
    /// Size without the repeated columns and rows.
    pub unpadded: ImageSize,
    /// Pixels of the original image per pixel here.
    pub original_from_here: DVec2,
}

impl PreparedImage {
    /// Prepares a grey image so that its longer side has at most `max_side` pixels and both sides
    /// are multiples of `multiple`.
    #[must_use]
    pub fn new(grey: &[f32], size: ImageSize, max_side: usize, multiple: usize) -> Self {
        let ImageSize { width, height } = size;
        let scale = (max_side as f64 / width.max(height) as f64).min(1.0);
        let unpadded = size.map(|side| ((side as f64 * scale).round() as usize).clamp(1, side));
        let small = if scale < 1.0 {
            shrink(grey, size, unpadded)
        } else {
            None
        };
        let full = unpadded.map(|side| side.next_multiple_of(multiple));
        Self {
            grey: padded(small.as_deref().unwrap_or(grey), unpadded, full),
            width: full.width,
            height: full.height,
            unpadded,
            original_from_here: DVec2::new(
                width as f64 / unpadded.width as f64,
                height as f64 / unpadded.height as f64,
            ),
        }
    }
}

fn shrink(grey: &[f32], from: ImageSize, to: ImageSize) -> Option<Vec<f32>> {
    let image =
        ImageBuffer::<Luma<f32>, &[f32]>::from_raw(from.width as u32, from.height as u32, grey)?;
    let (width, height) = (to.width as u32, to.height as u32);
    Some(resize(&image, width, height, FilterType::Triangle).into_raw())
}

/// Repeats the last column and row of an image up to a size.
fn padded(grey: &[f32], from: ImageSize, to: ImageSize) -> Vec<f32> {
    let mut wide = Vec::with_capacity(to.width * to.height);
    for row in grey.chunks_exact(from.width) {
        wide.extend_from_slice(row);
        wide.resize(wide.len() + to.width - from.width, row[from.width - 1]);
    }
    let last = wide.len() - to.width;
    for _ in from.height..to.height {
        wide.extend_from_within(last..last + to.width);
    }
    wide
}

/// A keypoint in a prepared image.
pub struct DetectedKeypoint {
    /// In pixels of the prepared image.
    pub at: DVec2,
    /// Confidence of the network, 0–1.
    pub score: f32,
}

/// An image in which a network finds keypoints.
pub struct NetworkImage<'a> {
    /// Its size.
    pub size: ImageSize,
    /// The image as the network sees it.
    pub shown: PreparedImage,
    allowed: Option<&'a [bool]>,
    content: Content,
}

impl<'a> NetworkImage<'a> {
    /// Prepares a grey image with sides of at most `max_side` pixels that are multiples of `multiple`.
    ///
    /// Keypoints lie only where `allowed` is true, and not in black bars at the sides of the image.
    pub fn new(
        grey: &[f32],
        size: ImageSize,
        allowed: Option<&'a [bool]>,
        max_side: usize,
        multiple: usize,
    ) -> Self {
        let shown = PreparedImage::new(grey, size, max_side, multiple);
        Self {
            size,
            shown,
            allowed,
            content: Content::of(grey, size.width, size.height),
        }
    }

    /// Returns the `most` strongest keypoints, of equal ones the first.
    ///
    /// Keypoints are described by `around` pixels of the prepared image and stay that far from a
    /// bar.
    pub fn strongest(
        &self,
        found: impl Iterator<Item = DetectedKeypoint>,
        most: usize,
        around: f32,
    ) -> Vec<DetectedKeypoint> {
        let mut found: Vec<DetectedKeypoint> = found
            .filter(|found| self.allows(found.at, around))
            .collect();
        found.sort_by(|a, b| b.score.total_cmp(&a.score));
        found.truncate(most);
        found
    }

    /// Returns whether a keypoint may lie at a position in the prepared image.
    ///
    /// It is described by `around` pixels of the prepared image and stays that far from a bar.
    pub fn allows(&self, at: DVec2, around: f32) -> bool {
        let around = around * self.shown.original_from_here.max_element() as f32;
        let px = at * self.shown.original_from_here;
        let (x, y) = (
            (px.x as usize).min(self.size.width - 1),
            (px.y as usize).min(self.size.height - 1),
        );
        self.allowed
            .is_none_or(|mask| mask[y * self.size.width + x])
            && self.content.holds(px.as_vec2(), around)
    }

    /// Returns the keypoints with descriptors of `dim` values, which `describe` writes for a
    /// position in the prepared image.
    pub fn features(
        &self,
        found: &[DetectedKeypoint],
        dim: usize,
        describe: impl Fn(DVec2, &mut [f32]),
    ) -> Features {
        let mut values = vec![0.0; found.len() * dim];
        found
            .iter()
            .zip(values.chunks_exact_mut(dim))
            .for_each(|(found, row)| describe(found.at, row));
        Features {
            width: self.size.width as u32,
            height: self.size.height as u32,
            keypoints: found
                .iter()
                .map(|found| found.at * self.shown.original_from_here)
                .collect(),
            scales_px: Vec::new(),
            orientations: Vec::new(),
            scores: found.iter().map(|found| found.score).collect(),
            descriptors: Descriptors::Floats { dim, values },
        }
    }

    /// Runs the network on the image; returns the given number of planes per output.
    ///
    /// A plane has one value per cell of `cell` pixels.
    ///
    /// # Errors
    /// Fails if the network returns something else.
    pub fn run<const N: usize>(
        &self,
        network: &Network,
        input: &str,
        planes: [usize; N],
        cell: usize,
    ) -> Result<[Tensor; N], NnError> {
        let shown = &self.shown;
        let given = Tensor::floats(&[1, 1, shown.height, shown.width], shown.grey.clone())?;
        let given = network.run(&[(input, &given)])?;
        let expected =
            planes.map(|planes| vec![1, planes, shown.height / cell, shown.width / cell]);
        let shapes: Vec<&[usize]> = given.iter().map(Tensor::shape).collect();
        let what = format!("gives {shapes:?} where {expected:?} are expected");
        let mismatch = || NnError::Mismatch {
            path: network.path().to_owned(),
            what,
        };
        if shapes != expected {
            return Err(mismatch());
        }
        <[Tensor; N]>::try_from(given).map_err(|_| mismatch())
    }
}

/// Loads the network of an entry that has a single file.
pub fn load_only(folder: &Path, name: &str) -> Result<Network, NnError> {
    let missing = || NnError::Request(format!("the catalogue has no file for `{name}`"));
    load(folder, name)?.pop().ok_or_else(missing)
}

/// With fewer matches than this in the first pass, two images do not overlap.
const OVERLAPPING: usize = 10;

/// Matches the first `most` keypoints of both images, if they overlap.
///
/// If there are more than `first_keypoints`, a first pass matches only so many; if too few match, these
/// are returned. A network's time grows with the square of the number of keypoints, and most pairs
/// of a set do not overlap.
pub fn match_twice(
    both: [&Features; 2],
    first_keypoints: usize,
    most: usize,
    matched: impl Fn(usize) -> Result<Vec<(u32, u32)>, FeatureError>,
) -> Result<Vec<(u32, u32)>, FeatureError> {
    let fewer = both
        .iter()
        .map(|features| features.keypoints.len().min(most))
        .min()
        .unwrap_or(0);
    if fewer > first_keypoints {
        let glanced = matched(first_keypoints)?;
        if glanced.len() < OVERLAPPING {
            return Ok(glanced);
        }
    }
    matched(most)
}

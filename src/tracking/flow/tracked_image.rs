use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Weak};

use glam::Vec2;
use rayon::prelude::*;

use super::dis::PATCH;
use super::memory::{DenseFeatures, FeatureMap};
use super::plane::{Plane, Pyramid, corners};
use crate::propagate::PassFrame;
use ostra_core::image::ImageSize;
use ostra_frames::Image;
use ostra_masks::lab::lab_of_pixel;
use ostra_masks::{LabelId, LabelMask, MaskError};

/// A frame's image, prepared for the tracker.
pub(super) struct TrackedImage {
    pub width: usize,
    pub height: usize,
    /// CIE Lab, row by row.
    pub lab: Vec<[f32; 3]>,
    /// Colour bin of every pixel.
    pub bins: Vec<u16>,
    /// Grey levels for optical flow.
    pub pyramid: Pyramid,
    /// Features of the cells, if a network computes them.
    pub feature_map: Option<Arc<FeatureMap>>,
}

/// Returns the working size: the longer side has at most `most_side` pixels.
pub(super) fn working_size(width: u32, height: u32, most_side: u32) -> ImageSize {
    let longest = width.max(height).max(1);
    let side = |length: u32| {
        let scaled = f64::from(length) * f64::from(most_side.min(longest)) / f64::from(longest);
        (scaled.round() as usize).max(1)
    };
    ImageSize::new(side(width), side(height))
}

impl TrackedImage {
    /// Reduces the image to this size.
    pub fn new(image: &Image, size: ImageSize) -> Self {
        let ImageSize { width, height } = size;
        let rgb = reduced(image, width, height);
        let byte = |channel: f32| (channel + 0.5) as u8;
        let lab: Vec<[f32; 3]> = rgb
            .par_iter()
            .with_min_len(4096)
            .map(|&p| lab_of_pixel(p.map(byte)))
            .collect();
        let bins = lab.iter().map(|&lab| bin_of(lab)).collect();
        let grey = rgb
            .iter()
            .map(|&[r, g, b]| 0.299 * r + 0.587 * g + 0.114 * b)
            .collect();
        let pyramid = Pyramid::new(
            Plane {
                width,
                height,
                values: grey,
            },
            2 * PATCH,
        );
        Self {
            width,
            height,
            lab,
            bins,
            pyramid,
            feature_map: None,
        }
    }

    /// Adds the features of the cells.
    pub fn with_feature_map(mut self, features: &dyn DenseFeatures) -> Result<Self, MaskError> {
        let grey = self.pyramid.levels[0]
            .pixels()
            .map(|grey| grey / 255.0)
            .collect::<Vec<f32>>();
        self.feature_map = Some(Arc::new(
            features.feature_map(&grey, ImageSize::new(self.width, self.height))?,
        ));
        Ok(self)
    }
}

/// Reduces the image by area averaging; values are 0–255 per channel.
fn reduced(image: &Image, width: usize, height: usize) -> Vec<[f32; 3]> {
    let (across, down) = (
        Resampling::new(image.width as usize, width),
        Resampling::new(image.height as usize, height),
    );
    let full = image.width as usize;
    let mut out = vec![[0.0; 3]; width * height];
    out.par_chunks_exact_mut(width)
        .enumerate()
        .for_each(|(y, out)| {
            let mut mean = vec![[0.0f32; 3]; full];
            for (row, share) in down.of(y) {
                for (mean, pixel) in mean
                    .iter_mut()
                    .zip(&image.pixels[row * full..(row + 1) * full])
                {
                    (0..3).for_each(|channel| mean[channel] += share * f32::from(pixel[channel]));
                }
            }
            across.row(&mean, out);
        });
    out
}

/// Reduces a mask to the working size.
///
/// Each pixel takes the label at its centre. A label that would get no pixel keeps the one that
/// contains its first pixel.
pub(super) fn reduced_mask(mask: &LabelMask, size: ImageSize) -> LabelMask {
    let ImageSize { width, height } = size;
    let place = |at: usize, target: usize, source: u32| {
        ((2 * at + 1) * source as usize / (2 * target)) as u32
    };
    let mut ids: Vec<LabelId> = (0..height)
        .flat_map(|y| (0..width).map(move |x| (x, y)))
        .map(|(x, y)| mask.at(place(x, width, mask.width), place(y, height, mask.height)))
        .collect();
    let mut known: BTreeSet<LabelId> = ids.iter().copied().collect();
    for (at, &id) in mask
        .ids
        .iter()
        .enumerate()
        .filter(|(_, id)| **id != LabelId::NONE)
    {
        if known.insert(id) {
            let (x, y) = (at % mask.width as usize, at / mask.width as usize);
            ids[y * height / mask.height as usize * width + x * width / mask.width as usize] = id;
        }
    }
    LabelMask {
        width: width as u32,
        height: height as u32,
        ids,
    }
}

/// Enlarges a mask from the working size to a frame's own size.
///
/// Each pixel takes the label with the largest bilinear weight among the four pixels around it, so
/// outlines are smooth.
pub(super) fn enlarged_mask(mask: &LabelMask, width: u32, height: u32) -> LabelMask {
    if (mask.width, mask.height) == (width, height) {
        return mask.clone();
    }
    let scale = Vec2::new(
        mask.width as f32 / width as f32,
        mask.height as f32 / height as f32,
    );
    let mut ids = vec![LabelId::NONE; width as usize * height as usize];
    ids.par_chunks_exact_mut(width as usize)
        .enumerate()
        .for_each(|(y, row)| {
            for (x, id) in row.iter_mut().enumerate() {
                let at = (Vec2::new(x as f32, y as f32) + 0.5) * scale - 0.5;
                let (corner, weights) = corners(at, mask.width as usize, mask.height as usize);
                let labels = corner.map(|corner| mask.ids[corner]);
                let weight_of = |label| {
                    labels
                        .iter()
                        .zip(weights)
                        .filter(|(l, _)| **l == label)
                        .map(|(_, w)| w)
                        .sum::<f32>()
                };
                *id = labels
                    .into_iter()
                    .max_by(|&a, &b| weight_of(a).total_cmp(&weight_of(b)))
                    .unwrap_or(LabelId::NONE);
            }
        });
    LabelMask { width, height, ids }
}

/// Source pixels of each target pixel in a row, with their shares of its length.
struct Resampling {
    /// First source pixel per target pixel, and the shares from there on.
    shares: Vec<(usize, Vec<f32>)>,
}

impl Resampling {
    /// Prepares the reduction of `source` pixels to `target` pixels, which must not be more.
    pub fn new(source: usize, target: usize) -> Self {
        let step = source as f64 / target as f64;
        let shares = (0..target).map(|at| {
            let (start, end) = (at as f64 * step, (at + 1) as f64 * step);
            let (first, last) = (start as usize, (end.ceil() as usize).min(source));
            let share = |pixel: usize| {
                ((end.min(pixel as f64 + 1.0) - start.max(pixel as f64)) / step) as f32
            };
            (first, (first..last).map(share).collect())
        });
        Self {
            shares: shares.collect(),
        }
    }

    /// Averages one row of pixels by area, per channel.
    pub fn row<const N: usize>(&self, source: &[[f32; N]], target: &mut [[f32; N]]) {
        for ((first, shares), target) in self.shares.iter().zip(target) {
            *target = [0.0; N];
            for (share, pixel) in shares.iter().zip(&source[*first..]) {
                (0..N).for_each(|channel| target[channel] += share * pixel[channel]);
            }
        }
    }

    /// Returns the source rows of one target row, with their shares.
    pub fn of(&self, target: usize) -> impl Iterator<Item = (usize, f32)> + '_ {
        let (first, shares) = &self.shares[target];
        shares
            .iter()
            .enumerate()
            .map(move |(at, &share)| (first + at, share))
    }
}

/// Cache of the frames' prepared images at one size.
pub(super) struct ImageCache<'a> {
    size: ImageSize,
    features: Option<&'a dyn DenseFeatures>,
    /// Images still in use, by frame.
    made: BTreeMap<usize, Weak<TrackedImage>>,
}

impl<'a> ImageCache<'a> {
    pub fn new(size: ImageSize, features: Option<&'a dyn DenseFeatures>) -> Self {
        Self {
            size,
            features,
            made: BTreeMap::new(),
        }
    }

    /// Returns a frame's prepared image; the same one as long as it is in use.
    ///
    /// # Errors
    /// [`MaskError::Network`] if its features cannot be computed.
    pub fn get(&mut self, frame: &PassFrame) -> Result<Arc<TrackedImage>, MaskError> {
        if let Some(image) = self.made.get(&frame.index).and_then(Weak::upgrade) {
            return Ok(image);
        }
        let image = TrackedImage::new(&frame.image, self.size);
        let image = Arc::new(match self.features {
            Some(features) => image.with_feature_map(features)?,
            None => image,
        });
        self.made.retain(|_, image| image.strong_count() > 0);
        self.made.insert(frame.index, Arc::downgrade(&image));
        Ok(image)
    }
}

const LIGHT: usize = 16;
const CHROMA: usize = 24;
const BINS: usize = LIGHT * CHROMA * CHROMA;
/// Share assumed for a colour that neither the object nor its surroundings have shown.
const UNSEEN: f32 = 1e-4;
/// Largest log-odds.
const MOST: f32 = 3.0;

/// Returns the bin of a Lab colour.
pub(super) fn bin_of([l, a, b]: [f32; 3]) -> u16 {
    let bin = |value: f32, least: f32, range: f32, bins: usize| {
        (((value - least) / range * bins as f32).max(0.0) as usize).min(bins - 1)
    };
    let (l, a, b) = (
        bin(l, 0.0, 100.0, LIGHT),
        bin(a, -80.0, 160.0, CHROMA),
        bin(b, -80.0, 160.0, CHROMA),
    );
    ((l * CHROMA + a) * CHROMA + b) as u16
}

/// Smoothed Lab histograms of an object and its surroundings.
#[derive(Clone)]
pub(super) struct ColorModel {
    object: Vec<f32>,
    around: Vec<f32>,
}

impl ColorModel {
    /// Counts the bins of the pixels selected by `is_object` and by `is_around`.
    pub fn new(bins: &[u16], is_object: &[bool], is_around: &[bool]) -> Self {
        Self {
            object: histogram(bins, is_object),
            around: histogram(bins, is_around),
        }
    }

    /// Returns the log-odds of each bin belonging to the object, −3 to 3.
    pub fn odds(&self) -> Vec<f32> {
        let odds = |(&object, &around): (&f32, &f32)| {
            ((object + UNSEEN) / (around + UNSEEN))
                .ln()
                .clamp(-MOST, MOST)
        };
        self.object.iter().zip(&self.around).map(odds).collect()
    }

    /// Moves by `share` towards another model.
    pub fn learn(&mut self, other: &Self, share: f32) {
        let blend = |mine: &mut [f32], other: &[f32]| {
            mine.iter_mut()
                .zip(other)
                .for_each(|(mine, other)| *mine += share * (other - *mine));
        };
        blend(&mut self.object, &other.object);
        blend(&mut self.around, &other.around);
    }

    /// Returns the similarity of two models' object colours, 0–1 (Bhattacharyya coefficient).
    pub fn likeness(&self, other: &Self) -> f32 {
        self.object
            .iter()
            .zip(&other.object)
            .map(|(a, b)| (a * b).sqrt())
            .sum::<f32>()
            .min(1.0)
    }
}

/// Returns the smoothed share of each bin; all 0 if no pixel counts.
fn histogram(bins: &[u16], counts: &[bool]) -> Vec<f32> {
    let mut shares = vec![0.0; BINS];
    let mut total = 0.0f32;
    for (&bin, _) in bins.iter().zip(counts).filter(|(_, counts)| **counts) {
        shares[usize::from(bin)] += 1.0;
        total += 1.0;
    }
    for (step, length) in [(1, CHROMA), (CHROMA, CHROMA), (CHROMA * CHROMA, LIGHT)] {
        smooth(&mut shares, step, length);
    }
    shares.iter_mut().for_each(|share| *share /= total.max(1.0));
    shares
}

/// Smooths with the weights 1 2 1 along one axis; the end values are repeated.
fn smooth(values: &mut [f32], step: usize, length: usize) {
    for first in (0..values.len()).filter(|at| (at / step).is_multiple_of(length)) {
        let mut before = values[first];
        for at in 0..length {
            let place = first + at * step;
            let here = values[place];
            let after = if at + 1 < length {
                values[place + step]
            } else {
                here
            };
            values[place] = (before + 2.0 * here + after) / 4.0;
            before = here;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn resampling_averages_by_area() {
        let mut target = [[0.0]; 2];
        Resampling::new(3, 2).row(&[[0.0], [3.0], [9.0]], &mut target);
        assert!(
            (target[0][0] - 1.0).abs() < 1e-6 && (target[1][0] - 7.0).abs() < 1e-6,
            "{target:?}"
        );
    }

    #[test]
    fn object_colours_have_positive_odds() {
        let (red, blue, green) = (
            bin_of([50.0, 60.0, 40.0]),
            bin_of([30.0, 20.0, -60.0]),
            bin_of([60.0, -50.0, 50.0]),
        );
        let bins = [red, red, blue, blue];
        let model = ColorModel::new(
            &bins,
            &[true, true, false, false],
            &[false, false, true, true],
        );
        let odds = model.odds();
        assert!(odds[usize::from(red)] > 2.0 && odds[usize::from(blue)] < -2.0);
        assert!(odds[usize::from(green)].abs() < 1e-3);
        assert!((model.likeness(&model) - 1.0).abs() < 1e-5);
        assert!((model.object.iter().sum::<f32>() - 1.0).abs() < 1e-5);
    }
}

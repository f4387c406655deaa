use std::collections::BTreeSet;
use std::sync::Arc;

use glam::Vec2;
use rayon::prelude::*;

use super::colors::bin_of;
use super::dis::PATCH;
use super::memory::{Describer, Description};
use super::plane::{Plane, corners};
use super::pyramid::Pyramid;
use super::sampling::Resampling;
use ostra_frames::Image;
use ostra_masks::lab::lab_of_pixel;
use ostra_masks::{LabelId, LabelMask, MaskError};

/// A frame's picture as the tracker works on it.
pub(super) struct Picture {
    pub width: usize,
    pub height: usize,
    /// CIE Lab, row by row.
    pub lab: Vec<[f32; 3]>,
    /// Colour bin of every pixel.
    pub bins: Vec<u16>,
    /// Grey levels, for optical flow.
    pub pyramid: Pyramid,
    /// What its cells look like, where something describes them.
    pub description: Option<Arc<Description>>,
}

/// The size at which a frame is worked on: its longer side has at most `most_side` pixels.
pub(super) fn working_size(width: u32, height: u32, most_side: u32) -> (usize, usize) {
    let longest = width.max(height).max(1);
    let side = |length: u32| {
        let scaled = f64::from(length) * f64::from(most_side.min(longest)) / f64::from(longest);
        (scaled.round() as usize).max(1)
    };
    (side(width), side(height))
}

impl Picture {
    /// The picture reduced to this size.
    pub fn new(image: &Image, (width, height): (usize, usize)) -> Self {
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
            description: None,
        }
    }

    /// The same with its cells described.
    pub fn described(mut self, describer: &dyn Describer) -> Result<Self, MaskError> {
        let grey = self.pyramid.levels[0]
            .pixels()
            .map(|grey| grey / 255.0)
            .collect::<Vec<f32>>();
        self.description = Some(Arc::new(
            describer.describe(&grey, (self.width, self.height))?,
        ));
        Ok(self)
    }
}

/// Means by area, 0–255 per channel.
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

/// A mask at the working size: each pixel takes the label in its middle; a label that none would take keeps the pixel
/// that its first one lies in.
pub(super) fn reduced_mask(mask: &LabelMask, (width, height): (usize, usize)) -> LabelMask {
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

/// A mask of the working size at a frame's own: each pixel takes the label that has the most of the four pixels around
/// it, so that outlines run smoothly.
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

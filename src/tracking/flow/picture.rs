use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::{Arc, Weak};

use glam::Vec2;
use rayon::prelude::*;

use super::colors::bin_of;
use super::dis::PATCH;
use super::memory::{Describer, Description};
use super::plane::{Plane, Pyramid, corners};
use ostra_core::job::Progress;
use ostra_frames::{FrameError, Image};
use ostra_masks::lab::lab_of_pixel;
use ostra_masks::{LabelId, LabelMask, MaskError, TrackRequest};

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

/// Which source pixels make each target pixel of a row, with their shares of its length.
struct Resampling {
    /// Per target pixel: the first source pixel, and the shares of it and of those after it.
    shares: Vec<(usize, Vec<f32>)>,
}

impl Resampling {
    /// From `source` to at most as many `target` pixels by area.
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

    /// One row of pixels, each channel averaged by area.
    pub fn row<const N: usize>(&self, source: &[[f32; N]], target: &mut [[f32; N]]) {
        for ((first, shares), target) in self.shares.iter().zip(target) {
            *target = [0.0; N];
            for (share, pixel) in shares.iter().zip(&source[*first..]) {
                (0..N).for_each(|channel| target[channel] += share * pixel[channel]);
            }
        }
    }

    /// Source rows and shares that make one target row.
    pub fn of(&self, target: usize) -> impl Iterator<Item = (usize, f32)> + '_ {
        let (first, shares) = &self.shares[target];
        shares
            .iter()
            .enumerate()
            .map(move |(at, &share)| (first + at, share))
    }
}

/// Frames that a walk backwards loads together, in rising order: a film is decoded forwards only.
const BLOCK: usize = 16;

/// The most unread frames that a warning names.
const NAMED: usize = 5;

/// The pictures of a request, each at the size that is asked for. Frames that cannot be read are noted and passed over.
pub(super) struct Pictures<'a> {
    request: &'a TrackRequest,
    progress: &'a Progress,
    describer: Option<&'a dyn Describer>,
    /// Those that somebody may still hold, by frame.
    made: BTreeMap<usize, Weak<Picture>>,
    unread: BTreeMap<usize, FrameError>,
}

impl<'a> Pictures<'a> {
    /// The pictures of this request's frames.
    pub fn new(
        request: &'a TrackRequest,
        describer: Option<&'a dyn Describer>,
        progress: &'a Progress,
    ) -> Self {
        Self {
            request,
            progress,
            describer,
            made: BTreeMap::new(),
            unread: BTreeMap::new(),
        }
    }

    /// A frame's picture, the same one as long as somebody holds it; `None` where it cannot be read.
    pub fn load(
        &mut self,
        frame: usize,
        size: (usize, usize),
    ) -> Result<Option<Arc<Picture>>, MaskError> {
        self.progress.check()?;
        let held = self.made.get(&frame).and_then(Weak::upgrade);
        if let Some(picture) = held.filter(|picture| (picture.width, picture.height) == size) {
            return Ok(Some(picture));
        }
        let image = match self.request.store.image(&self.request.frames[frame]) {
            Ok(image) => image,
            Err(error) => {
                self.unread.insert(frame, error);
                return Ok(None);
            }
        };
        let picture = Picture::new(&image, size);
        let picture = Arc::new(match self.describer {
            Some(describer) => picture.described(describer)?,
            None => picture,
        });
        self.made.retain(|_, picture| picture.strong_count() > 0);
        self.made.insert(frame, Arc::downgrade(&picture));
        Ok(Some(picture))
    }

    /// The first of the frames that could not be read, as an error.
    pub fn failure(&mut self) -> Option<MaskError> {
        self.unread.pop_first().map(|(_, error)| error.into())
    }

    /// One line that names the frames which could not be read.
    pub fn warnings(&self) -> Vec<String> {
        let Some(first) = self.unread.values().next() else {
            return Vec::new();
        };
        let names: Vec<&str> = self
            .unread
            .keys()
            .map(|&frame| self.request.frames[frame].name.as_str())
            .collect();
        let more = names.len().checked_sub(NAMED).filter(|&more| more > 0);
        let more = more.map_or_else(String::new, |more| format!(" and {more} more"));
        let named = names[..names.len().min(NAMED)].join(", ");
        vec![format!(
            "{} frames cannot be read and were stepped over: {named}{more} ({first})",
            names.len()
        )]
    }
}

/// The pictures along a walk, in its order.
pub(super) struct Route {
    size: (usize, usize),
    /// How many frames are loaded together.
    block: usize,
    coming: VecDeque<usize>,
    loaded: VecDeque<(usize, Arc<Picture>)>,
}

impl Route {
    /// From the frame next to `start` to `last`, which lies before or after it.
    pub fn new(start: usize, last: usize, size: (usize, usize)) -> Self {
        let forwards = last > start;
        let coming = if forwards {
            (start + 1..=last).collect()
        } else {
            (last..start).rev().collect()
        };
        Self {
            size,
            block: if forwards { 1 } else { BLOCK },
            coming,
            loaded: VecDeque::new(),
        }
    }

    /// The next frame that can be read, with its picture; `None` at the end.
    pub fn next(
        &mut self,
        pictures: &mut Pictures<'_>,
    ) -> Result<Option<(usize, Arc<Picture>)>, MaskError> {
        while self.loaded.is_empty() && !self.coming.is_empty() {
            let mut block: Vec<usize> = self
                .coming
                .drain(..self.block.min(self.coming.len()))
                .collect();
            block.sort_unstable();
            for frame in block {
                let picture = pictures.load(frame, self.size)?;
                self.loaded.extend(picture.map(|picture| (frame, picture)));
            }
        }
        // A block of several lies in rising order and is walked from its end.
        Ok(self.loaded.pop_back())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_are_taken_by_area() {
        let mut target = [[0.0]; 2];
        Resampling::new(3, 2).row(&[[0.0], [3.0], [9.0]], &mut target);
        assert!(
            (target[0][0] - 1.0).abs() < 1e-6 && (target[1][0] - 7.0).abs() < 1e-6,
            "{target:?}"
        );
    }
}

//! Writing a selection of points back to masks: the pixels of a frame that see them.

use glam::Vec3;
use rayon::prelude::*;

use crate::SceneError;
use crate::conflicts::{self, FILL_PX, Lifted, MaskedFrame};
use crate::fuse::Votes;
use crate::select::{Selection, Selector};
use ostra_masks::{Connectivity, LabelId, LabelMask, Region, components};

/// Finds the pixels that see the selected points of a cloud.
pub struct SeeingPixels<'a> {
    selector: &'a Selector,
    votes: &'a Votes,
    /// Whether each point is selected.
    chosen: Vec<bool>,
    /// Bounding box of the selected points, extended by `reach`.
    ///
    /// `reach` is the maximum distance between a pixel's 3-D position and a selected point.
    bounds: (Vec3, Vec3),
    reach: f32,
}

/// What a pixel is known to see.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum PixelState {
    /// Selected points.
    Chosen,
    /// Other points, or a place without a point.
    Other,
    /// Unknown.
    Blind,
}

/// Numbers of selected and other points that a pixel is recorded to see.
#[derive(Clone, Copy, Default)]
struct Observations {
    chosen: u16,
    others: u16,
}

impl<'a> SeeingPixels<'a> {
    /// Prepares the queries per frame.
    ///
    /// # Errors
    ///
    /// Returns [`SceneError::Request`] if the votes belong to another cloud or do not include the
    /// voting pixels.
    pub fn new(
        selector: &'a Selector,
        votes: &'a Votes,
        selection: &Selection,
    ) -> Result<Self, SceneError> {
        let refuse = |why: &str| Err(SceneError::Request(format!("{why}; fuse again")));
        let positions = &selector.cloud().positions;
        if votes.len() != positions.len() {
            return refuse("the votes belong to another cloud");
        }
        if !votes.has_voters() {
            return refuse(
                "the pixels that voted were not kept, as they would not fit into memory",
            );
        }
        let mut chosen = vec![false; positions.len()];
        selection
            .points
            .iter()
            .for_each(|&point| chosen[point as usize] = true);
        let reach = conflicts::REACH as f32 * selector.spacing();
        let places = || {
            selection
                .points
                .iter()
                .map(|&point| positions[point as usize])
        };
        let bounds = (
            places().fold(Vec3::INFINITY, Vec3::min) - reach,
            places().fold(Vec3::NEG_INFINITY, Vec3::max) + reach,
        );
        Ok(Self {
            selector,
            votes,
            chosen,
            bounds,
            reach,
        })
    }

    /// Returns the pixels of a frame that see selected points, or `None` if there are none.
    ///
    /// A pixel follows the majority of the points that it is recorded to see. If none are recorded,
    /// it follows the point at its position given by the depth map, and without one the nearest
    /// pixel that sees a point. Unknown pixels follow those of the same label in the mask around
    /// them, and unlabelled holes are closed, so that an object is corrected as a whole.
    ///
    /// The record of the vote takes precedence, so that a correction is written where the wrong
    /// label came from. Afterwards the masks vote again on the same points, with the result that a
    /// new fusion would give them.
    #[must_use]
    pub fn in_frame(&self, masked: &MaskedFrame<'_>) -> Option<Region> {
        let mask = masked.mask;
        let recorded = self.recorded(masked.number, mask.width, mask.height)?;
        let lifted = masked
            .depth
            .and_then(|depth| Lifted::new(masked.frame, depth));
        let pixel = |at: usize| match (recorded[at].pixel(), &lifted) {
            (Some(pixel), _) => pixel,
            (None, Some(lifted)) => self.at_place(lifted, at),
            (None, None) => nearest(&recorded, at, mask.width),
        };
        let mut pixels: Vec<PixelState> = (0..recorded.len()).into_par_iter().map(pixel).collect();
        close_blind(&mut pixels, mask);
        let inside = pixels
            .into_iter()
            .map(|pixel| pixel == PixelState::Chosen)
            .collect();
        Some(Region {
            width: mask.width,
            height: mask.height,
            inside,
        })
    }

    /// Returns the recorded sightings of each pixel, or `None` if no pixel sees a selected point.
    fn recorded(&self, frame: usize, width: u32, height: u32) -> Option<Vec<Observations>> {
        let mut recorded = vec![Observations::default(); width as usize * height as usize];
        let mut any = false;
        for (point, x, y) in self
            .votes
            .observations(frame)
            .filter(|&(_, x, y)| x < width && y < height)
        {
            let pixel = &mut recorded[(y * width + x) as usize];
            let count = if self.chosen[point] {
                &mut pixel.chosen
            } else {
                &mut pixel.others
            };
            *count = count.saturating_add(1);
            any |= self.chosen[point];
        }
        any.then_some(recorded)
    }

    fn at_place(&self, lifted: &Lifted<'_>, at: usize) -> PixelState {
        let Some(place) = lifted.place(at) else {
            return PixelState::Blind;
        };
        let near = place.cmpge(self.bounds.0).all() && place.cmple(self.bounds.1).all();
        let is_chosen = || {
            let (point, distance) = self.selector.nearest(place);
            distance <= self.reach && self.chosen[point]
        };
        if near && is_chosen() {
            PixelState::Chosen
        } else {
            PixelState::Other
        }
    }
}

impl Observations {
    fn pixel(self) -> Option<PixelState> {
        match (self.chosen, self.others) {
            (0, 0) => None,
            (chosen, others) if chosen >= others => Some(PixelState::Chosen),
            _ => Some(PixelState::Other),
        }
    }
}

/// Returns what the nearest pixel with a recorded point sees, within a few columns and rows.
///
/// Among equally near pixels the first one wins.
fn nearest(recorded: &[Observations], at: usize, width: u32) -> PixelState {
    let (width, reach) = (width as usize, FILL_PX as usize);
    let (x, y) = (at % width, at / width);
    let columns = x.saturating_sub(reach)..=(x + reach).min(width - 1);
    let rows = y.saturating_sub(reach)..=(y + reach).min(recorded.len() / width - 1);
    let around = rows.flat_map(|row| columns.clone().map(move |column| (column, row)));
    let seeing = around.filter_map(|(column, row)| {
        let pixel = recorded[row * width + column].pixel()?;
        Some((column.abs_diff(x).pow(2) + row.abs_diff(y).pow(2), pixel))
    });
    seeing
        .min_by_key(|&(squared, _)| squared)
        .map_or(PixelState::Blind, |(_, pixel)| pixel)
}

/// Distance over which unknown pixels of a label follow known ones, as a share of the longer side.
const REACH: f64 = 1.0 / 40.0;
/// Distance over which unlabelled pixels follow known ones.
///
/// It is short because an empty mask does not hold pixels together.
const UNLABELLED_REACH: usize = 2;

/// Adds unknown pixels to the selected ones.
///
/// These are the pixels nearest to selected ones along pixels of the same label in `mask`, and
/// unlabelled holes enclosed by selected pixels.
fn close_blind(pixels: &mut [PixelState], mask: &LabelMask) {
    let mut known: Vec<PixelState> = pixels.to_vec();
    let mut front: Vec<usize> = (0..pixels.len())
        .filter(|&at| pixels[at] != PixelState::Blind)
        .collect();
    let reach = (REACH * f64::from(mask.width.max(mask.height))).ceil() as usize;
    for step in 0..reach {
        let mut next = Vec::new();
        for at in front {
            let goes_on = mask.ids[at] != LabelId::NONE || step < UNLABELLED_REACH;
            for other in adjacent(at, mask).filter(|_| goes_on) {
                if known[other] == PixelState::Blind && mask.ids[other] == mask.ids[at] {
                    known[other] = known[at];
                    next.push(other);
                }
            }
        }
        front = next;
    }
    let holes = holes(&known, mask);
    for (at, pixel) in pixels.iter_mut().enumerate() {
        if known[at] == PixelState::Chosen || holes[at] {
            *pixel = PixelState::Chosen;
        }
    }
}

/// Returns the unlabelled, unknown pixels that selected pixels enclose on all sides.
fn holes(known: &[PixelState], mask: &LabelMask) -> Vec<bool> {
    let inside = known
        .iter()
        .zip(&mask.ids)
        .map(|(&pixel, &id)| pixel == PixelState::Blind && id == LabelId::NONE)
        .collect();
    let unknown = components(
        &Region {
            width: mask.width,
            height: mask.height,
            inside,
        },
        Connectivity::Four,
    );
    let mut open = vec![false; unknown.areas.len() + 1];
    open[0] = true;
    for at in (0..known.len()).filter(|&at| unknown.labels[at] > 0) {
        let own = unknown.labels[at];
        let closed = adjacent(at, mask)
            .filter(|&other| unknown.labels[other] == own || known[other] == PixelState::Chosen);
        open[own as usize] |= closed.count() < 4;
    }
    unknown
        .labels
        .iter()
        .map(|&piece| !open[piece as usize])
        .collect()
}

/// Returns the pixels to the left, to the right, above and below.
fn adjacent(at: usize, mask: &LabelMask) -> impl Iterator<Item = usize> + use<> {
    let (width, height) = (mask.width as usize, mask.height as usize);
    let (x, y) = (at % width, at / width);
    let left = (x > 0).then(|| at - 1);
    let right = (x + 1 < width).then_some(at + 1);
    let above = (y > 0).then(|| at - width);
    let below = (y + 1 < height).then_some(at + width);
    [left, right, above, below].into_iter().flatten()
}

#[cfg(test)]
mod tests;

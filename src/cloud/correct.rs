//! A choice of points written back: the pixels of a frame that see them.

use glam::Vec3;
use rayon::prelude::*;

use crate::SceneError;
use crate::doubt::{self, FILL_PX, Lifted};
use crate::fuse::Votes;
use crate::select::{Selection, Selector};
use ostra_frames::{DepthMap, Frame};
use ostra_masks::{Connectivity, LabelId, LabelMask, Region, components};

/// Who sees the chosen points of a cloud.
pub struct SeeingPixels<'a> {
    selector: &'a Selector,
    votes: &'a Votes,
    /// Whether each point is chosen.
    chosen: Vec<bool>,
    /// The box around the chosen points, as far as pixels may lie from them.
    bounds: (Vec3, Vec3),
    reach: f32,
}

/// What a pixel is known to see.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Pixel {
    /// Chosen points.
    Chosen,
    /// Others, or what has no point.
    Other,
    /// Nobody knows what.
    Blind,
}

/// How many points a pixel is recorded to see.
#[derive(Clone, Copy, Default)]
struct Sightings {
    chosen: u16,
    others: u16,
}

impl<'a> SeeingPixels<'a> {
    /// Makes ready to ask frame by frame.
    ///
    /// # Errors
    /// [`SceneError::Request`] where the votes belong to another cloud, or do not know who voted.
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
        let reach = doubt::REACH as f32 * selector.spacing();
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

    /// The pixels of a frame that see chosen points; `None` where it sees none.
    ///
    /// A pixel goes with most of the points that it is recorded to see. Where none is recorded, it goes with the point at its
    /// place by `depth`, else with the nearest pixel that sees one. Pixels of which nothing is known go with those of the same
    /// label in `mask` around them, and holes without a label are closed, so that a part moves whole.
    ///
    /// The record of the vote comes first, so that a correction is written where the wrong label came from.
    /// Afterwards the masks vote again on the same points, with the result that a new fusion would give them.
    #[must_use]
    pub fn in_frame(
        &self,
        (number, frame): (usize, &Frame),
        depth: Option<&DepthMap>,
        mask: &LabelMask,
    ) -> Option<Region> {
        let recorded = self.recorded(number, (mask.width, mask.height))?;
        let lifted = depth.and_then(|depth| Lifted::new(frame, depth));
        let pixel = |at: usize| match (recorded[at].pixel(), &lifted) {
            (Some(pixel), _) => pixel,
            (None, Some(lifted)) => self.at_place(lifted, at),
            (None, None) => nearest(&recorded, at, mask.width),
        };
        let mut pixels: Vec<Pixel> = (0..recorded.len()).into_par_iter().map(pixel).collect();
        close_blind(&mut pixels, mask);
        let inside = pixels
            .into_iter()
            .map(|pixel| pixel == Pixel::Chosen)
            .collect();
        Some(Region {
            width: mask.width,
            height: mask.height,
            inside,
        })
    }

    /// What the votes know of each pixel; `None` where it sees no chosen point.
    fn recorded(&self, frame: usize, (width, height): (u32, u32)) -> Option<Vec<Sightings>> {
        let mut recorded = vec![Sightings::default(); width as usize * height as usize];
        let mut any = false;
        for (point, x, y) in self
            .votes
            .sightings(frame)
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

    fn at_place(&self, lifted: &Lifted<'_>, at: usize) -> Pixel {
        let Some(place) = lifted.place(at) else {
            return Pixel::Blind;
        };
        let near = place.cmpge(self.bounds.0).all() && place.cmple(self.bounds.1).all();
        let is_chosen = || {
            let (point, distance) = self.selector.nearest(place);
            distance <= self.reach && self.chosen[point]
        };
        if near && is_chosen() {
            Pixel::Chosen
        } else {
            Pixel::Other
        }
    }
}

impl Sightings {
    fn pixel(self) -> Option<Pixel> {
        match (self.chosen, self.others) {
            (0, 0) => None,
            (chosen, others) if chosen >= others => Some(Pixel::Chosen),
            _ => Some(Pixel::Other),
        }
    }
}

/// What the nearest pixel that sees a point sees, a few columns and rows away at most; of equally near ones the first.
fn nearest(recorded: &[Sightings], at: usize, width: u32) -> Pixel {
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
        .map_or(Pixel::Blind, |(_, pixel)| pixel)
}

/// How far a label's pixels of which nothing is known go with those that see something, as a share of the longer side.
const REACH: f64 = 1.0 / 40.0;
/// Pixels without a label go along so far only: a mask that says nothing does not hold them together.
const UNLABELLED_REACH: usize = 2;

/// Gives pixels that see nothing known to the chosen ones: those that are nearest to chosen ones along pixels of the same
/// label in `mask`, and holes without a label that chosen pixels enclose.
fn close_blind(pixels: &mut [Pixel], mask: &LabelMask) {
    let mut known: Vec<Pixel> = pixels.to_vec();
    let mut front: Vec<usize> = (0..pixels.len())
        .filter(|&at| pixels[at] != Pixel::Blind)
        .collect();
    let reach = (REACH * f64::from(mask.width.max(mask.height))).ceil() as usize;
    for step in 0..reach {
        let mut next = Vec::new();
        for at in front {
            let goes_on = mask.ids[at] != LabelId::NONE || step < UNLABELLED_REACH;
            for other in beside(at, mask).filter(|_| goes_on) {
                if known[other] == Pixel::Blind && mask.ids[other] == mask.ids[at] {
                    known[other] = known[at];
                    next.push(other);
                }
            }
        }
        front = next;
    }
    let holes = holes(&known, mask);
    for (at, pixel) in pixels.iter_mut().enumerate() {
        if known[at] == Pixel::Chosen || holes[at] {
            *pixel = Pixel::Chosen;
        }
    }
}

/// The pixels without a label, of which nothing is known, that chosen pixels enclose on all sides.
fn holes(known: &[Pixel], mask: &LabelMask) -> Vec<bool> {
    let inside = known
        .iter()
        .zip(&mask.ids)
        .map(|(&pixel, &id)| pixel == Pixel::Blind && id == LabelId::NONE)
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
        let closed = beside(at, mask)
            .filter(|&other| unknown.labels[other] == own || known[other] == Pixel::Chosen);
        open[own as usize] |= closed.count() < 4;
    }
    unknown
        .labels
        .iter()
        .map(|&piece| !open[piece as usize])
        .collect()
}

/// The pixels left, right, above and below.
fn beside(at: usize, mask: &LabelMask) -> impl Iterator<Item = usize> + use<> {
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

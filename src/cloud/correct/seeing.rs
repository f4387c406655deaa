use glam::Vec3;
use rayon::prelude::*;

use super::blind::close_blind;
use crate::SceneError;
use crate::doubt::{FILL_PX, Lifted, REACH};
use crate::fuse::Votes;
use crate::select::{Selection, Selector};
use ostra_frames::{DepthMap, Frame};
use ostra_masks::{LabelMask, Region};

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
pub(super) enum Pixel {
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
        let reach = REACH as f32 * selector.spacing();
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

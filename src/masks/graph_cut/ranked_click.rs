//! Clicks with all of their candidates, for fitting the weights that rank them.

use std::sync::Arc;

use super::candidates::{CandidateOptions, candidates};
use super::prepared::{Prepared, RegionQuery};
use super::ranking::{ClickKind, TERMS, kind_of, terms};
use super::segmenter::prepare;
use crate::{Click, MaskError, Region};
use ostra_core::job::Progress;
use ostra_frames::{DepthMap, Image};

/// A frame prepared for clicks whose candidate is chosen by the caller.
pub struct RankedFrame(Prepared);

/// A click to apply.
#[derive(Debug, Clone, Copy)]
pub struct RankedClick<'a> {
    /// The click.
    pub click: Click,
    /// Earlier clicks on the object, and clicks on other objects as exclude clicks.
    pub earlier: &'a [Click],
    /// Answer before this click; `None` for the first click.
    pub previous: Option<&'a Region>,
    /// Pixels that belong to other objects and may not be taken.
    pub taken: &'a Region,
}

/// The candidates of a click.
#[derive(Debug, Clone)]
pub struct ClickCandidates {
    /// Kind of the click.
    pub kind: ClickKind,
    /// Which regions change, per candidate.
    pub changes: Vec<Vec<bool>>,
    /// Terms of the score, per candidate.
    pub terms: Vec<[f32; TERMS]>,
    /// IoU of every two candidates.
    pub shared: Vec<Vec<f32>>,
}

impl RankedFrame {
    /// Prepares a frame as [`BuiltinSegmenter`](super::BuiltinSegmenter) does.
    ///
    /// # Errors
    /// Same as [`BuiltinSegmenter`](super::BuiltinSegmenter).
    pub fn new(
        image: &Arc<Image>,
        depth: Option<&DepthMap>,
        progress: &Progress,
    ) -> Result<Self, MaskError> {
        prepare(image, depth, progress).map(Self)
    }

    /// Returns the region of each pixel, row by row.
    #[must_use]
    pub fn region_of_pixel(&self) -> &[u32] {
        &self.0.raster.of_pixel
    }

    /// Returns the number of regions.
    #[must_use]
    pub fn region_count(&self) -> usize {
        self.0.graph.region_count()
    }

    /// Applies a click with the candidate that `choose` picks.
    ///
    /// `choose` is not called if the click changes nothing.
    ///
    /// # Panics
    /// Panics if `choose` returns an index that is out of range.
    pub fn answer(
        &self,
        request: &RankedClick<'_>,
        choose: &mut dyn FnMut(&ClickCandidates) -> usize,
    ) -> Region {
        let mut query = RegionQuery::new(&self.0, Some(request.taken));
        if let Some(previous) = request.previous {
            query.start_from(previous);
        }
        request
            .earlier
            .iter()
            .for_each(|click| query.add_known_click(click));
        query.note_new_click(&request.click);
        let change = query.context().map(|context| {
            let found = candidates(&context, &CandidateOptions::default());
            let (changes, terms) = found
                .all
                .into_iter()
                .map(|one| (one.change, terms(&one.features)))
                .unzip();
            let mut found = ClickCandidates {
                kind: kind_of(&context),
                changes,
                terms,
                shared: found.shared,
            };
            let chosen = choose(&found);
            found.changes.swap_remove(chosen)
        });
        if let Some(change) = change {
            query.apply(&change, request.click.include);
        }
        query.answer()
    }
}

//! A click with all of its candidates, for fitting the weights that rank them.

use std::sync::Arc;

use super::candidates::{CandidateOptions, candidates};
use super::prepared::{Prepared, Query};
use super::ranking::{Kind, TERMS, kind_of, terms};
use super::segmenter::prepare;
use crate::{Click, MaskError, Region};
use ostra_core::job::Progress;
use ostra_frames::{DepthMap, Image};

/// A frame prepared for clicks whose candidates are chosen by the caller.
pub struct RankedFrame(Prepared);

/// A click to answer.
#[derive(Debug, Clone, Copy)]
pub struct RankedClick<'a> {
    /// The click.
    pub click: Click,
    /// Earlier clicks for the object, and those for other objects as exclude clicks.
    pub earlier: &'a [Click],
    /// The answer before; `None` for the first click.
    pub previous: Option<&'a Region>,
    /// Pixels that belong to other objects and may not be taken.
    pub taken: &'a Region,
}

/// The candidates of a click.
#[derive(Debug, Clone)]
pub struct ClickCandidates {
    /// The kind of the click.
    pub kind: Kind,
    /// Per candidate, which regions change.
    pub changes: Vec<Vec<bool>>,
    /// Per candidate, the terms of its score.
    pub terms: Vec<[f32; TERMS]>,
    /// IoU of every two candidates.
    pub shared: Vec<Vec<f32>>,
}

impl RankedFrame {
    /// Prepares a frame as [`BuiltinSegmenter`](super::BuiltinSegmenter) does.
    ///
    /// # Errors
    /// As there.
    pub fn new(
        image: &Arc<Image>,
        depth: Option<&DepthMap>,
        progress: &Progress,
    ) -> Result<Self, MaskError> {
        prepare(image, depth, progress).map(Self)
    }

    /// The region that each pixel belongs to, row by row.
    #[must_use]
    pub fn region_of_pixel(&self) -> &[u32] {
        &self.0.raster.of_pixel
    }

    /// Number of regions.
    #[must_use]
    pub fn region_count(&self) -> usize {
        self.0.graph.region_count()
    }

    /// Answers a click with the candidate that `choose` picks; it is not asked where the click changes nothing.
    ///
    /// # Panics
    /// When it picks none of the candidates.
    pub fn answer(
        &self,
        request: &RankedClick<'_>,
        choose: &mut dyn FnMut(&ClickCandidates) -> usize,
    ) -> Region {
        let mut query = Query::new(&self.0, Some(request.taken));
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

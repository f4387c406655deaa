use std::collections::BTreeMap;
use std::sync::Arc;

use rayon::prelude::*;

use super::outcome::ViewOutcome;
use super::pictures::Pictures;
use super::plan::{Planned, PlannedView, plan};
use super::store::{DepthStore, Stage};
use crate::engine::job::Progress;
use crate::frames::cameras::SparsePoints;
use crate::frames::{Frame, FrameStore};
use crate::scene::SceneError;
use crate::scene::stereo::filter::{FilterOptions, Neighbour, completed, filter, snapped};
use crate::scene::stereo::patchmatch::{Found, PatchMatchOptions, Picture, Round, Search};
use crate::scene::stereo::{DepthEstimate, Engine, SelectOptions, StereoError};

/// How depth is made of posed pictures.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default)]
pub struct StereoOptions {
    /// Longer side of the raster that depth is found on, 32–8192 pixels; pictures are never enlarged.
    pub max_side: u32,
    /// Rounds with geometric consistency, 0–4.
    pub rounds: u32,
    /// Memory for pictures being worked on.
    pub picture_budget_bytes: usize,
    /// Which views are compared.
    pub select: SelectOptions,
    /// How planes are searched.
    pub patchmatch: PatchMatchOptions,
    /// What is kept.
    pub filter: FilterOptions,
}

impl Default for StereoOptions {
    fn default() -> Self {
        Self {
            max_side: 1600,
            rounds: 2,
            picture_budget_bytes: 96 << 20,
            select: SelectOptions::default(),
            patchmatch: PatchMatchOptions::default(),
            filter: FilterOptions::default(),
        }
    }
}

/// Which pixels of a frame's raster (its camera's `width · height`, row by row) are to be worked on; `None` = all.
pub type RasterMask<'a> = &'a (dyn Fn(usize, &crate::geometry::Camera) -> Option<Vec<bool>> + Sync);

/// Frames, and which of them get depth.
#[derive(Clone, Copy)]
pub struct StereoRequest<'a> {
    /// All frames, by number.
    pub frames: &'a [Frame],
    /// Numbers of the frames that get depth, ascending.
    pub views: &'a [usize],
    /// Points with the keypoints that see them ([`crate::scene::stereo::sparse_from_cameras`] where there are none).
    pub sparse: &'a SparsePoints,
    /// Masked reconstruction.
    pub mask: RasterMask<'a>,
    /// What it runs on.
    pub engine: &'a Engine,
}

/// Depth of every view that can have one: PatchMatch by the pictures alone, rounds with geometric consistency, filtering,
/// completion.
/// Each view's result goes to `depths` as soon as it is there; what is there already is not made again. Gives what became
/// of each view.
///
/// # Errors
/// [`StereoError::Scene`] where `depths` fails, [`StereoError::Gpu`], [`StereoError::Stopped`]; what was kept until then stays.
pub fn estimate_depths(
    request: &StereoRequest<'_>,
    store: &FrameStore,
    depths: &dyn DepthStore,
    options: &StereoOptions,
    progress: &Progress,
) -> Result<BTreeMap<usize, ViewOutcome>, StereoError> {
    let coarsest = (options.max_side, options.patchmatch.coarsest_px);
    let mut pictures = Pictures::new(request.frames, store, coarsest, options.picture_budget_bytes);
    progress.stage("choose views")?;
    let Planned { views, mut outcomes } = plan(request, &mut pictures, &options.select, progress)?;
    let work = Work { request, depths, options, progress };
    for round in 0..=options.rounds {
        progress.stage(if round == 0 { "depth" } else { "consistent depth" })?;
        for (done, view) in views.iter().enumerate() {
            progress.step(done, views.len())?;
            // Of a run that goes on, earlier rounds of what was done later are gone.
            let mut done_since = (round..=options.rounds).map(Stage::Round).chain([Stage::Filtered, Stage::Complete]);
            if !done_since.any(|stage| depths.has(view.frame, stage)) {
                depths.save(view.frame, Stage::Round(round), work.searched(view, round, &mut pictures)?)?;
            }
        }
        if round > 0 {
            depths.forget(Stage::Round(round - 1))?;
        }
    }
    progress.stage("filter")?;
    for (done, view) in views.iter().enumerate() {
        progress.step(done, views.len())?;
        work.filter(view, &mut pictures)?;
    }
    depths.forget(Stage::Round(options.rounds))?;
    progress.stage("complete")?;
    for (done, view) in views.iter().enumerate() {
        progress.step(done, views.len())?;
        let pixels = work.complete(view, &mut pictures)?;
        outcomes.insert(view.frame, ViewOutcome::Done { pixels, sources: view.sources.clone() });
    }
    depths.forget(Stage::Filtered)?;
    Ok(outcomes)
}

/// What all steps of a run look at.
struct Work<'a> {
    request: &'a StereoRequest<'a>,
    depths: &'a dyn DepthStore,
    options: &'a StereoOptions,
    progress: &'a Progress,
}

impl Work<'_> {
    /// A view's depth after a round.
    fn searched(
        &self,
        view: &PlannedView,
        round: u32,
        pictures: &mut Pictures<'_>,
    ) -> Result<DepthEstimate, StereoError> {
        let mut get = |number: usize| pictures.get(number).map_err(SceneError::Request);
        let reference = get(view.frame)?;
        let sources: Vec<Arc<Picture>> = view.sources.iter().map(|&number| get(number)).collect::<Result<_, _>>()?;
        let allowed = (self.request.mask)(view.frame, &reference.camera);
        let task = Search {
            reference: &reference,
            sources: &sources,
            depth_range: view.depth_range,
            seeds: &view.seeds,
            allowed: allowed.as_deref(),
        };
        let (engine, options) = (self.request.engine, &self.options.patchmatch);
        let found = match round.checked_sub(1) {
            None => engine.search(&task, options, self.progress)?,
            Some(before) => {
                let unknown = || DepthEstimate::empty(reference.camera).found(&reference);
                let start = self.found(view.frame, before, &reference)?.unwrap_or_else(unknown);
                let of_source = |(&number, picture): (&usize, &Arc<Picture>)| {
                    Ok(self.found(number, before, picture)?.map(Arc::new))
                };
                let others: Vec<Option<Arc<Found>>> =
                    view.sources.par_iter().zip(&sources).map(of_source).collect::<Result<_, StereoError>>()?;
                let round = Round { start: &start, others: &others, before };
                engine.search_consistent(&task, &round, options, self.progress)?
            }
        };
        Ok(DepthEstimate::new(&found, &reference))
    }

    /// What a round found in a view, or what was kept of that in the end.
    fn found(&self, number: usize, round: u32, picture: &Picture) -> Result<Option<Found>, StereoError> {
        Ok(self.kept(number, Stage::Round(round))?.map(|estimate| estimate.found(picture)))
    }

    /// A view's depth at a stage, or else at the next one that there is.
    fn kept(&self, number: usize, stage: Stage) -> Result<Option<Arc<DepthEstimate>>, StereoError> {
        for stage in [stage, Stage::Filtered, Stage::Complete] {
            if let Some(estimate) = self.depths.load(number, stage)? {
                return Ok(Some(estimate));
            }
        }
        Ok(None)
    }

    /// Keeps of a view's depth what its sources agree with, if that is not done yet.
    fn filter(&self, view: &PlannedView, pictures: &mut Pictures<'_>) -> Result<(), StereoError> {
        let last = Stage::Round(self.options.rounds);
        let is_done = [Stage::Filtered, Stage::Complete].iter().any(|&stage| self.depths.has(view.frame, stage));
        let Some(own) = (if is_done { None } else { self.depths.load(view.frame, last)? }) else { return Ok(()) };
        let (reference, neighbours) = self.neighbours((view.frame, &view.sources), last, pictures)?;
        let own = snapped(&own, &reference.levels[0], &self.options.filter.snap);
        Ok(self.depths.save(view.frame, Stage::Filtered, filter(&own, &neighbours, &self.options.filter))?)
    }

    /// Takes over into a view's depth what those around it see, if that is not done yet; gives the number of its pixels.
    fn complete(&self, view: &PlannedView, pictures: &mut Pictures<'_>) -> Result<usize, StereoError> {
        if !self.depths.has(view.frame, Stage::Complete)
            && let Some(own) = self.depths.load(view.frame, Stage::Filtered)?
        {
            let (reference, neighbours) = self.neighbours((view.frame, &view.around), Stage::Filtered, pictures)?;
            let allowed = (self.request.mask)(view.frame, &reference.camera);
            let estimate = completed(&own, &reference, allowed.as_deref(), &neighbours, &self.options.filter);
            self.depths.save(view.frame, Stage::Complete, estimate)?;
        }
        let kept = self.depths.load(view.frame, Stage::Complete)?;
        Ok(kept.map_or(0, |kept| kept.depths.iter().filter(|&&depth| depth > 0.0).count()))
    }

    /// A view's picture, and the depths of others at a stage.
    fn neighbours(
        &self,
        (view, others): (usize, &[usize]),
        stage: Stage,
        pictures: &mut Pictures<'_>,
    ) -> Result<(Arc<Picture>, Vec<Neighbour>), StereoError> {
        let mut get = |number: usize| pictures.get(number).map_err(SceneError::Request);
        let reference = get(view)?;
        let kept: Vec<_> = others.par_iter().map(|&number| self.kept(number, stage)).collect::<Result<_, _>>()?;
        let mut neighbours = Vec::new();
        for (&number, estimate) in others.iter().zip(kept) {
            let Some(estimate) = estimate else { continue };
            neighbours.push(Neighbour::new(&reference, get(number)?.as_ref(), estimate));
        }
        Ok((reference, neighbours))
    }
}

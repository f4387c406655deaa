use std::collections::BTreeMap;
use std::sync::Arc;

use super::outcome::ViewOutcome;
use super::pictures::Pictures;
use super::plan::{Planned, plan};
use super::store::{DepthStore, Stage};
use crate::engine::job::Progress;
use crate::frames::cameras::SparsePoints;
use crate::frames::{Frame, FrameStore};
use crate::scene::stereo::filter::{FilterOptions, Neighbour, filter, snapped};
use crate::scene::stereo::patchmatch::{Found, PatchMatchOptions, Picture, Search};
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

/// Depth of every view that can have one: PatchMatch by the pictures alone, rounds with geometric consistency, filtering.
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
    let mut planned = plan(request, &mut pictures, &options.select, progress)?;
    for round in 0..=options.rounds {
        progress.stage(if round == 0 { "depth" } else { "consistent depth" })?;
        for done in 0..planned.views.len() {
            progress.step(done, planned.views.len())?;
            let number = planned.views[done].frame;
            // Of a run that goes on, earlier rounds of what was done later are gone.
            let mut done_since = (round..=options.rounds).map(Stage::Round).chain([Stage::Filtered]);
            if !done_since.any(|stage| depths.has(number, stage)) {
                let estimate = one_round(&planned, done, round, request, &mut pictures, depths, options, progress)?;
                depths.save(number, Stage::Round(round), estimate)?;
            }
        }
        if round > 0 {
            depths.forget(Stage::Round(round - 1))?;
        }
    }
    filter_all(&mut planned, &mut pictures, depths, options, progress)?;
    Ok(planned.outcomes)
}

#[expect(clippy::too_many_arguments, reason = "one step of a loop whose state these are")]
fn one_round(
    planned: &Planned,
    at: usize,
    round: u32,
    request: &StereoRequest<'_>,
    pictures: &mut Pictures<'_>,
    depths: &dyn DepthStore,
    options: &StereoOptions,
    progress: &Progress,
) -> Result<DepthEstimate, StereoError> {
    let view = &planned.views[at];
    let mut get = |number: usize| pictures.get(number).map_err(crate::scene::SceneError::Request);
    let reference = get(view.frame)?;
    let sources: Vec<Arc<Picture>> = view.sources.iter().map(|&number| get(number)).collect::<Result<_, _>>()?;
    let allowed = (request.mask)(view.frame, &reference.camera);
    let task = Search {
        reference: &reference,
        sources: &sources,
        depth_range: view.depth_range,
        seeds: &view.seeds,
        allowed: allowed.as_deref(),
    };
    let found = if round == 0 {
        request.engine.search(&task, &options.patchmatch, progress)?
    } else {
        let before = Stage::Round(round - 1);
        let found_of = |number: usize, picture: &Picture| -> Result<Option<Found>, StereoError> {
            let estimate = match depths.load(number, before)? {
                Some(estimate) => Some(estimate),
                None => depths.load(number, Stage::Filtered)?,
            };
            Ok(estimate.map(|estimate| estimate.found(picture)))
        };
        let mut others = Vec::new();
        for (&number, picture) in view.sources.iter().zip(&sources) {
            others.push(found_of(number, picture)?.map(Arc::new));
        }
        let unknown = || DepthEstimate::empty(reference.camera).found(&reference);
        let start = found_of(view.frame, &reference)?.unwrap_or_else(unknown);
        request.engine.search_consistent(&task, &start, &others, round - 1, &options.patchmatch, progress)?
    };
    Ok(DepthEstimate::new(&found, &reference))
}

fn filter_all(
    planned: &mut Planned,
    pictures: &mut Pictures<'_>,
    depths: &dyn DepthStore,
    options: &StereoOptions,
    progress: &Progress,
) -> Result<(), StereoError> {
    progress.stage("filter")?;
    let last = Stage::Round(options.rounds);
    for (done, view) in planned.views.iter().enumerate() {
        progress.step(done, planned.views.len())?;
        if depths.load(view.frame, Stage::Filtered)?.is_none() {
            let mut get = |number: usize| pictures.get(number).map_err(crate::scene::SceneError::Request);
            let Some(own) = depths.load(view.frame, last)? else { continue };
            let reference = get(view.frame)?;
            let mut neighbours = Vec::new();
            for &number in &view.sources {
                let Some(estimate) = depths.load(number, last)? else { continue };
                neighbours.push(Neighbour::new(&reference, get(number)?.as_ref(), estimate));
            }
            let own = snapped(&own, &reference.levels[0], &options.filter.snap);
            let filtered = filter(&own, &neighbours, &options.filter);
            depths.save(view.frame, Stage::Filtered, filtered)?;
        }
        let kept = depths.load(view.frame, Stage::Filtered)?;
        let pixels = kept.map_or(0, |kept| kept.depths.iter().filter(|&&depth| depth > 0.0).count());
        planned.outcomes.insert(view.frame, ViewOutcome::Done { pixels, sources: view.sources.clone() });
    }
    depths.forget(last)?;
    Ok(())
}

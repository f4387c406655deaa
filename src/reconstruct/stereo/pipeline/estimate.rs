//! Depth of every view: rounds, filtering and completion, as many views at once as memory allows.

use std::collections::{BTreeMap, VecDeque};
use std::panic::resume_unwind;
use std::sync::Arc;

use rayon::prelude::*;

use super::images::ImagePyramids;
use super::outcome::ViewOutcome;
use super::plan::{Planned, PlannedView, StereoRequest, plan};
use super::prepared::PreparedView;
use crate::stereo::filter::{FilterOptions, Neighbour, completed, filter, snapped};
use crate::stereo::patchmatch::{DepthSearch, PatchMatchOptions, PlaneMap, PosedImage, Round};
use crate::stereo::raster::raster_camera;
use crate::stereo::{DepthEstimate, DepthStore, SelectOptions, Stage, StereoError};
use ostra_cloud::SceneError;
use ostra_core::job::{PlannedStage, Progress};
use ostra_frames::{FrameError, FrameStore};

/// Options of depth estimation from posed images.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default)]
pub struct StereoOptions {
    /// Longer side of the raster on which depth is estimated, 32–8192 pixels; images are never enlarged.
    pub max_side: u32,
    /// Rounds with geometric consistency, 0–4.
    pub rounds: u32,
    /// Memory for images in use, in bytes.
    pub image_budget_bytes: usize,
    /// Options for the choice of source views.
    pub select: SelectOptions,
    /// Options of the plane search.
    pub patchmatch: PatchMatchOptions,
    /// Options of filtering.
    pub filter: FilterOptions,
}

impl Default for StereoOptions {
    fn default() -> Self {
        Self {
            max_side: 1600,
            rounds: 2,
            image_budget_bytes: 96 << 20,
            select: SelectOptions::default(),
            patchmatch: PatchMatchOptions::default(),
            filter: FilterOptions::default(),
        }
    }
}

/// Returns the stages of [`estimate_depths`] for views of so many pixels in all.
///
/// Weights are rough seconds on a desktop processor, as in [`crate::sfm::planned_stages`].
#[must_use]
pub fn planned_stages(views: usize, pixels: f64, options: &StereoOptions) -> Vec<PlannedStage> {
    let (views, megapixels) = (views as f64, pixels / 1e6);
    let stage = PlannedStage::new;
    let mut stages = vec![
        stage("choose views", "Choose views", 0.1 * views),
        stage(KEPT_STAGE, "Choose views", 0.02 * views),
    ];
    for round in 0..=options.rounds {
        stages.push(match round {
            0 => stage(round_stage(round), "Compute depth", 8.0 * megapixels),
            _ => stage(
                round_stage(round),
                "Check depth consistency",
                5.0 * megapixels,
            ),
        });
    }
    stages.extend([
        stage("filter", "Clean depth", 0.5 * megapixels),
        stage("complete", "Clean depth", 0.5 * megapixels),
        stage("count pixels", "Keep results", 0.05 * views),
    ]);
    stages
}

/// Stage in which results of an earlier run are looked for.
const KEPT_STAGE: &str = "look for results kept from earlier";

/// Returns the stage of a round of PatchMatch.
fn round_stage(round: u32) -> &'static str {
    if round == 0 {
        "depth"
    } else {
        "consistent depth"
    }
}

/// Estimates the depth of every view that can have one.
///
/// The steps are PatchMatch by the images alone, rounds with geometric consistency, filtering and
/// completion. Several views are processed at once, by threads of their own that share rayon's
/// global pool. Each view's result is stored in `depths` in order; sound results that already exist
/// are not computed again. Returns the outcome of each view.
///
/// # Errors
/// [`StereoError::Scene`] if `depths` fails, [`StereoError::Gpu`], [`StereoError::Stopped`];
/// results stored until then are kept.
pub fn estimate_depths(
    request: &StereoRequest<'_>,
    store: &FrameStore,
    depths: &dyn DepthStore,
    options: &StereoOptions,
    progress: &Progress,
) -> Result<BTreeMap<usize, ViewOutcome>, StereoError> {
    let mut images = ImagePyramids::new(
        request.frames,
        store,
        options.max_side,
        options.patchmatch.coarsest_px,
        options.image_budget_bytes,
    );
    progress.stage("choose views")?;
    let Planned {
        views,
        mut outcomes,
    } = plan(request, &mut images, &options.select, progress)?;
    let work = DepthEstimation::new(request, views, depths, options, progress)?;
    let mut make = |name: &str, stage: Stage| {
        progress.stage(name)?;
        work.make(stage, &mut images)
    };
    for round in 0..=options.rounds {
        make(round_stage(round), Stage::Round(round))?;
        if round > 0 {
            depths.forget(Stage::Round(round - 1))?;
        }
    }
    make("filter", Stage::Filtered)?;
    depths.forget(Stage::Round(options.rounds))?;
    make("complete", Stage::Complete)?;
    depths.forget(Stage::Filtered)?;
    outcomes.extend(work.outcomes(&images)?);
    Ok(outcomes)
}

/// Maximum number of pixels of the views processed at once, which bounds memory; a single view may have more.
///
/// The fountain at 1536×1024 takes 880 MiB, 508 with one view at a time (`cargo bench --bench
/// depths -- full`).
const PIXELS_AT_ONCE: usize = 4 << 20;

/// A run: its views, and the input of all steps.
pub struct DepthEstimation<'a> {
    request: &'a StereoRequest<'a>,
    depths: &'a dyn DepthStore,
    options: &'a StereoOptions,
    progress: &'a Progress,
    views: Vec<PlannedView>,
    /// Last stage of each view in an earlier run.
    reached: Vec<Option<Stage>>,
}

impl<'a> DepthEstimation<'a> {
    /// Finds the stages that an earlier run stored. Damaged ones count as missing.
    ///
    /// # Errors
    /// Those of the depth store, [`StereoError::Stopped`].
    pub fn new(
        request: &'a StereoRequest<'a>,
        views: Vec<PlannedView>,
        depths: &'a dyn DepthStore,
        options: &'a StereoOptions,
        progress: &'a Progress,
    ) -> Result<Self, StereoError> {
        progress.stage(KEPT_STAGE)?;
        let work = Self {
            request,
            depths,
            options,
            progress,
            views,
            reached: Vec::new(),
        };
        let reached = |(done, view): (usize, &PlannedView)| {
            work.report(done)?;
            Ok(work.reached(view.frame)?)
        };
        let reached = work
            .views
            .iter()
            .enumerate()
            .map(reached)
            .collect::<Result<_, StereoError>>()?;
        Ok(Self { reached, ..work })
    }

    /// Computes a stage of all views that have not reached it, several at once.
    ///
    /// Each result is stored in order, including those that finish after another has failed.
    ///
    /// Each view has a thread of its own, because one that waits for the graphics card would block
    /// a thread of rayon's pool. The calling thread reads images and stores depths, in the order of
    /// the views, and a stage reads finished stages only. So the result is the same to the bit for
    /// any number of views at once. (After damage the missing depth is computed from what is left,
    /// which may be of a later stage, and then need not be the same.)
    ///
    /// # Errors
    /// The first one of the depth store or the engine, [`StereoError::Stopped`].
    pub fn make(&self, stage: Stage, images: &mut ImagePyramids<'_>) -> Result<(), StereoError> {
        let pairs = self.views.iter().zip(&self.reached);
        let open: Vec<_> = pairs
            .filter(|&(_, &reached)| reached < Some(stage))
            .map(|(view, _)| view)
            .collect();
        let (at_once, mut done) = (self.at_once(), self.views.len() - open.len());
        let mut open = open.into_iter();
        std::thread::scope(|scope| {
            let (mut working, mut outcome) = (VecDeque::new(), self.report(done));
            loop {
                while outcome.is_ok()
                    && working.len() < at_once
                    && let Some(view) = open.next()
                {
                    match PreparedView::new(view, stage, images) {
                        Some(prepared) => {
                            let thread = scope.spawn(move || self.at_stage(&prepared, stage));
                            working.push_back((view.frame, thread));
                        }
                        None => done += 1,
                    }
                    outcome = self.report(done);
                }
                let Some((frame, oldest)) = working.pop_front() else {
                    return outcome;
                };
                let estimate = oldest.join().unwrap_or_else(|panic| resume_unwind(panic));
                let kept =
                    estimate.and_then(|estimate| Ok(self.depths.save(frame, stage, estimate)?));
                done += usize::from(kept.is_ok());
                outcome = outcome.and(kept).and(self.report(done));
            }
        })
    }

    /// Returns the outcomes of the views, once all are complete.
    ///
    /// # Errors
    /// Those of the depth store, [`StereoError::Stopped`].
    pub fn outcomes(
        self,
        images: &ImagePyramids<'_>,
    ) -> Result<Vec<(usize, ViewOutcome)>, StereoError> {
        self.progress.stage("count pixels")?;
        let unusable = images.unusable();
        let mut outcomes = Vec::new();
        for view in &self.views {
            self.report(outcomes.len())?;
            if let Some(outcome) = unusable.get(&view.frame)
                && self.sound(view.frame, Stage::Complete)?.is_none()
            {
                outcomes.push((view.frame, outcome.clone()));
                continue;
            }
            let pixels = self
                .own(view, Stage::Complete)?
                .depths
                .iter()
                .filter(|&&depth| depth > 0.0)
                .count();
            outcomes.push((
                view.frame,
                ViewOutcome::Done {
                    pixels,
                    sources: view
                        .sources
                        .iter()
                        .filter(|source| !unusable.contains_key(source))
                        .copied()
                        .collect(),
                },
            ));
        }
        Ok(outcomes)
    }

    /// Reports how many views are done, and checks for a stop.
    fn report(&self, done: usize) -> Result<(), StereoError> {
        Ok(self.progress.step(done, self.views.len())?)
    }

    /// Returns as many views as keep the engine busy and memory allows.
    fn at_once(&self) -> usize {
        let pixels = |view: &PlannedView| {
            let (lens, _) = self.request.frames[view.frame].posed_camera()?;
            let raster = raster_camera(lens, self.options.max_side);
            Some(raster.width as usize * raster.height as usize)
        };
        let largest = self.views.iter().filter_map(pixels).max().unwrap_or(1);
        at_once(largest, self.request.engine.views_at_once())
    }

    /// Returns the last stage at which a view's depth is stored and sound.
    fn reached(&self, frame: usize) -> Result<Option<Stage>, SceneError> {
        for stage in self.since(Stage::Round(0)).rev() {
            if self.sound(frame, stage)?.is_some() {
                return Ok(Some(stage));
            }
        }
        Ok(None)
    }

    /// Returns a view's depth at a stage; `None` if it is missing or damaged.
    fn sound(&self, frame: usize, stage: Stage) -> Result<Option<Arc<DepthEstimate>>, SceneError> {
        match self.depths.load(frame, stage) {
            Err(SceneError::Frame(FrameError::Invalid { .. })) => Ok(None),
            loaded => loaded,
        }
    }

    /// Returns a stage and those after it.
    fn since(&self, stage: Stage) -> impl DoubleEndedIterator<Item = Stage> {
        let rounds = (0..=self.options.rounds).map(Stage::Round);
        rounds
            .chain([Stage::Filtered, Stage::Complete])
            .filter(move |&other| other >= stage)
    }

    /// Computes a view's depth at a stage from earlier stages.
    fn at_stage(
        &self,
        view: &PreparedView<'_>,
        stage: Stage,
    ) -> Result<DepthEstimate, StereoError> {
        match stage {
            Stage::Round(round) => self.searched(view, round),
            Stage::Filtered => self.filtered(view),
            Stage::Complete => self.completed(view),
        }
    }

    /// Computes a view's depth of a round.
    fn searched(
        &self,
        PreparedView {
            view,
            image,
            adjacent,
        }: &PreparedView<'_>,
        round: u32,
    ) -> Result<DepthEstimate, StereoError> {
        let sources: Vec<Arc<PosedImage>> = adjacent
            .iter()
            .map(|(_, image)| Arc::clone(image))
            .collect();
        let allowed = (self.request.mask)(view.frame, &image.camera);
        let task = DepthSearch {
            reference: image,
            sources: &sources,
            depth_range: view.depth_range,
            seeds: &view.seeds,
            allowed: allowed.as_deref(),
        };
        let (engine, options) = (self.request.engine, &self.options.patchmatch);
        let found = match round.checked_sub(1) {
            None => engine.search(&task, options, self.progress)?,
            Some(before) => {
                let start = self.own(view, Stage::Round(before))?.found(image);
                let of_source = |(number, image): &(usize, Arc<PosedImage>)| {
                    Ok(self
                        .kept(*number, Stage::Round(before))?
                        .map(|estimate| Arc::new(estimate.found(image))))
                };
                let others: Vec<Option<Arc<PlaneMap>>> = adjacent
                    .par_iter()
                    .map(of_source)
                    .collect::<Result<_, StereoError>>()?;
                let round = Round {
                    start: &start,
                    others: &others,
                    before,
                };
                engine.search_consistent(&task, &round, options, self.progress)?
            }
        };
        Ok(DepthEstimate::new(&found, image))
    }

    /// Computes the part of a view's depth that its sources agree with.
    fn filtered(&self, prepared: &PreparedView<'_>) -> Result<DepthEstimate, StereoError> {
        let (PreparedView { view, image, .. }, last) =
            (prepared, Stage::Round(self.options.rounds));
        let own = snapped(
            &*self.own(view, last)?,
            &image.levels[0],
            &self.options.filter.snap,
        );
        Ok(filter(
            &own,
            &self.neighbours(prepared, last)?,
            &self.options.filter,
        ))
    }

    /// Completes a view's depth by what its neighbours see.
    fn completed(&self, prepared: &PreparedView<'_>) -> Result<DepthEstimate, StereoError> {
        let PreparedView { view, image, .. } = prepared;
        let own = self.own(view, Stage::Filtered)?;
        let neighbours = self.neighbours(prepared, Stage::Filtered)?;
        let allowed = (self.request.mask)(view.frame, &image.camera);
        Ok(completed(
            &own,
            image,
            allowed.as_deref(),
            &neighbours,
            &self.options.filter,
        ))
    }

    /// Returns the depths of the neighbouring views at a stage.
    fn neighbours(
        &self,
        view: &PreparedView<'_>,
        stage: Stage,
    ) -> Result<Vec<Neighbour>, StereoError> {
        let kept: Vec<_> = view
            .adjacent
            .par_iter()
            .map(|&(number, _)| self.kept(number, stage))
            .collect::<Result<_, _>>()?;
        let pairs = view.adjacent.iter().zip(kept);
        let known = pairs.filter_map(|((_, image), estimate)| {
            Some(Neighbour::new(&view.image, image, estimate?))
        });
        Ok(known.collect())
    }

    /// Returns a view's own depth at a stage that was computed before.
    fn own(&self, view: &PlannedView, stage: Stage) -> Result<Arc<DepthEstimate>, StereoError> {
        let name = &self.request.frames[view.frame].name;
        let gone = || {
            SceneError::Request(format!(
                "{name}: the depth made for it is gone; reconstruct again"
            ))
        };
        Ok(self.kept(view.frame, stage)?.ok_or_else(gone)?)
    }

    /// Returns a view's depth at a stage, or at the next existing one in a resumed run.
    ///
    /// A resumed run finds no earlier rounds of views that are further on.
    fn kept(&self, number: usize, stage: Stage) -> Result<Option<Arc<DepthEstimate>>, StereoError> {
        for stage in self.since(stage) {
            if let Some(estimate) = self.sound(number, stage)? {
                return Ok(Some(estimate));
            }
        }
        Ok(None)
    }
}

/// Returns how many views of at most `pixels` pixels are processed at once, if `most` would keep the engine busy.
fn at_once(pixels: usize, most: usize) -> usize {
    (PIXELS_AT_ONCE / pixels).clamp(1, most)
}

#[cfg(test)]
mod tests {
    use super::at_once;

    #[test]
    fn large_views_are_processed_one_at_a_time() {
        assert_eq!(
            [640 * 480, 1600 * 1067, 3200 * 2400].map(|pixels| at_once(pixels, 4)),
            [4, 2, 1]
        );
        assert_eq!(at_once(640 * 480, 2), 2);
    }
}

//! Depth of every view: rounds, filtering and completion, as many views at once as memory holds.

use std::collections::{BTreeMap, VecDeque};
use std::panic::resume_unwind;
use std::sync::Arc;

use rayon::prelude::*;

use super::plan::{Pictures, Planned, PlannedView, StereoRequest, ViewOutcome, plan};
use crate::stereo::filter::{FilterOptions, Neighbour, completed, filter, snapped};
use crate::stereo::patchmatch::{Found, PatchMatchOptions, Picture, Round, Search};
use crate::stereo::raster::raster_camera;
use crate::stereo::{DepthEstimate, DepthStore, SelectOptions, Stage, StereoError};
use ostra_cloud::SceneError;
use ostra_core::job::Progress;
use ostra_frames::{FrameError, FrameStore};

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

/// Depth of every view that can have one: PatchMatch by the pictures alone, rounds with geometric consistency, filtering,
/// completion.
/// Some views are worked on at once, by threads of their own that share rayon's global pool. Each view's result goes to
/// `depths` in its turn; what is there already and sound is not made again. Gives what became of each view.
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
    let mut pictures = Pictures::new(
        request.frames,
        store,
        coarsest,
        options.picture_budget_bytes,
    );
    progress.stage("choose views")?;
    let Planned {
        views,
        mut outcomes,
    } = plan(request, &mut pictures, &options.select, progress)?;
    let work = Work::new((request, views), depths, options, progress)?;
    let mut make = |name: &str, stage: Stage| {
        progress.stage(name)?;
        work.make(stage, &mut pictures)
    };
    for round in 0..=options.rounds {
        make(
            if round == 0 {
                "depth"
            } else {
                "consistent depth"
            },
            Stage::Round(round),
        )?;
        if round > 0 {
            depths.forget(Stage::Round(round - 1))?;
        }
    }
    make("filter", Stage::Filtered)?;
    depths.forget(Stage::Round(options.rounds))?;
    make("complete", Stage::Complete)?;
    depths.forget(Stage::Filtered)?;
    outcomes.extend(work.outcomes()?);
    Ok(outcomes)
}

/// Most pixels of the views that are worked on at once, which bounds memory; one view may have more.
/// The fountain at 1536×1024 takes 880 MiB, 508 with one view at a time (`cargo bench --bench depths -- full`).
const PIXELS_AT_ONCE: usize = 4 << 20;

/// A run: its views, and what all steps look at.
pub struct Work<'a> {
    request: &'a StereoRequest<'a>,
    depths: &'a dyn DepthStore,
    options: &'a StereoOptions,
    progress: &'a Progress,
    views: Vec<PlannedView>,
    /// How far an earlier run brought each view.
    reached: Vec<Option<Stage>>,
}

/// A view with its picture and those of the views beside it.
struct Prepared<'a> {
    view: &'a PlannedView,
    picture: Arc<Picture>,
    beside: Vec<(usize, Arc<Picture>)>,
}

impl<'a> Prepared<'a> {
    /// Reads what a stage of a view looks at.
    fn new(
        view: &'a PlannedView,
        stage: Stage,
        pictures: &mut Pictures<'_>,
    ) -> Result<Self, SceneError> {
        let mut get = |number: usize| pictures.get(number).map_err(SceneError::Request);
        let picture = get(view.frame)?;
        let beside = if stage == Stage::Complete {
            &view.around
        } else {
            &view.sources
        };
        let beside = beside
            .iter()
            .map(|&number| Ok((number, get(number)?)))
            .collect::<Result<_, SceneError>>()?;
        Ok(Self {
            view,
            picture,
            beside,
        })
    }
}

impl<'a> Work<'a> {
    /// Looks at what an earlier run has kept. What is damaged counts as not made.
    ///
    /// # Errors
    /// What the store of depths said, [`StereoError::Stopped`].
    pub fn new(
        (request, views): (&'a StereoRequest<'a>, Vec<PlannedView>),
        depths: &'a dyn DepthStore,
        options: &'a StereoOptions,
        progress: &'a Progress,
    ) -> Result<Self, StereoError> {
        progress.stage("look for what is kept")?;
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

    /// Makes a stage of all views that are not that far, some of them at once. Each is kept in its turn, also those that
    /// end after another has failed.
    ///
    /// Each view has a thread of its own, since one that waits for the graphics card would block a thread of
    /// rayon's pool. Images are read and depths kept by the calling thread, in the order of the views, and a
    /// stage reads finished stages only, so that the result is the same to the bit for any number of views at
    /// once. (After damage the missing depth is made from what is left, which may be of a later stage, and then
    /// need not be the same.)
    ///
    /// # Errors
    /// The first that the store of depths or the engine said, [`StereoError::Stopped`].
    pub fn make(&self, stage: Stage, pictures: &mut Pictures<'_>) -> Result<(), StereoError> {
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
                    match Prepared::new(view, stage, pictures) {
                        Ok(prepared) => {
                            let thread = scope.spawn(move || self.at_stage(&prepared, stage));
                            working.push_back((view.frame, thread));
                            outcome = self.report(done);
                        }
                        Err(error) => outcome = Err(error.into()),
                    }
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

    /// What became of the views, once all are complete.
    ///
    /// # Errors
    /// What the store of depths said, [`StereoError::Stopped`].
    pub fn outcomes(self) -> Result<Vec<(usize, ViewOutcome)>, StereoError> {
        self.progress.stage("count pixels")?;
        let mut outcomes = Vec::new();
        for view in &self.views {
            self.report(outcomes.len())?;
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
                    sources: view.sources.clone(),
                },
            ));
        }
        Ok(outcomes)
    }

    /// Tells how many views are done, and notices a stop.
    fn report(&self, done: usize) -> Result<(), StereoError> {
        Ok(self.progress.step(done, self.views.len())?)
    }

    /// As many views as keep the engine busy and memory holds.
    fn at_once(&self) -> usize {
        let pixels = |view: &PlannedView| {
            let (lens, _) = self.request.frames[view.frame].posed_camera()?;
            let raster = raster_camera(lens, self.options.max_side);
            Some(raster.width as usize * raster.height as usize)
        };
        let largest = self.views.iter().filter_map(pixels).max().unwrap_or(1);
        at_once(largest, self.request.engine.views_at_once())
    }

    /// The last stage at which a view's depth is kept and sound.
    fn reached(&self, frame: usize) -> Result<Option<Stage>, SceneError> {
        for stage in self.since(Stage::Round(0)).rev() {
            if self.sound(frame, stage)?.is_some() {
                return Ok(Some(stage));
            }
        }
        Ok(None)
    }

    /// A view's depth at a stage; `None` where it is not there or damaged.
    fn sound(&self, frame: usize, stage: Stage) -> Result<Option<Arc<DepthEstimate>>, SceneError> {
        match self.depths.load(frame, stage) {
            Err(SceneError::Frame(FrameError::Invalid { .. })) => Ok(None),
            loaded => loaded,
        }
    }

    /// A stage and those after it.
    fn since(&self, stage: Stage) -> impl DoubleEndedIterator<Item = Stage> {
        let rounds = (0..=self.options.rounds).map(Stage::Round);
        rounds
            .chain([Stage::Filtered, Stage::Complete])
            .filter(move |&other| other >= stage)
    }

    /// A view's depth at a stage, from what was made before.
    fn at_stage(&self, view: &Prepared<'_>, stage: Stage) -> Result<DepthEstimate, StereoError> {
        match stage {
            Stage::Round(round) => self.searched(view, round),
            Stage::Filtered => self.filtered(view),
            Stage::Complete => self.completed(view),
        }
    }

    /// A view's depth after a round.
    fn searched(
        &self,
        Prepared {
            view,
            picture,
            beside,
        }: &Prepared<'_>,
        round: u32,
    ) -> Result<DepthEstimate, StereoError> {
        let sources: Vec<Arc<Picture>> = beside
            .iter()
            .map(|(_, picture)| Arc::clone(picture))
            .collect();
        let allowed = (self.request.mask)(view.frame, &picture.camera);
        let task = Search {
            reference: picture,
            sources: &sources,
            depth_range: view.depth_range,
            seeds: &view.seeds,
            allowed: allowed.as_deref(),
        };
        let (engine, options) = (self.request.engine, &self.options.patchmatch);
        let found = match round.checked_sub(1) {
            None => engine.search(&task, options, self.progress)?,
            Some(before) => {
                let start = self.own(view, Stage::Round(before))?.found(picture);
                let of_source = |(number, picture): &(usize, Arc<Picture>)| {
                    Ok(self
                        .kept(*number, Stage::Round(before))?
                        .map(|estimate| Arc::new(estimate.found(picture))))
                };
                let others: Vec<Option<Arc<Found>>> = beside
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
        Ok(DepthEstimate::new(&found, picture))
    }

    /// What of a view's depth its sources agree with.
    fn filtered(&self, prepared: &Prepared<'_>) -> Result<DepthEstimate, StereoError> {
        let (Prepared { view, picture, .. }, last) = (prepared, Stage::Round(self.options.rounds));
        let own = snapped(
            &*self.own(view, last)?,
            &picture.levels[0],
            &self.options.filter.snap,
        );
        Ok(filter(
            &own,
            &self.neighbours(prepared, last)?,
            &self.options.filter,
        ))
    }

    /// A view's depth, and what those around it see.
    fn completed(&self, prepared: &Prepared<'_>) -> Result<DepthEstimate, StereoError> {
        let Prepared { view, picture, .. } = prepared;
        let own = self.own(view, Stage::Filtered)?;
        let neighbours = self.neighbours(prepared, Stage::Filtered)?;
        let allowed = (self.request.mask)(view.frame, &picture.camera);
        Ok(completed(
            &own,
            picture,
            allowed.as_deref(),
            &neighbours,
            &self.options.filter,
        ))
    }

    /// The depths of the views beside a view at a stage.
    fn neighbours(&self, view: &Prepared<'_>, stage: Stage) -> Result<Vec<Neighbour>, StereoError> {
        let kept: Vec<_> = view
            .beside
            .par_iter()
            .map(|&(number, _)| self.kept(number, stage))
            .collect::<Result<_, _>>()?;
        let pairs = view.beside.iter().zip(kept);
        let known = pairs.filter_map(|((_, picture), estimate)| {
            Some(Neighbour::new(&view.picture, picture, estimate?))
        });
        Ok(known.collect())
    }

    /// A view's own depth at a stage, which was made before.
    fn own(&self, view: &PlannedView, stage: Stage) -> Result<Arc<DepthEstimate>, StereoError> {
        let name = &self.request.frames[view.frame].name;
        let gone = || {
            SceneError::Request(format!(
                "{name}: the depth made for it is gone; reconstruct again"
            ))
        };
        Ok(self.kept(view.frame, stage)?.ok_or_else(gone)?)
    }

    /// A view's depth at a stage; of a run that goes on, at the next one that there is: earlier rounds of what was done
    /// later are gone.
    fn kept(&self, number: usize, stage: Stage) -> Result<Option<Arc<DepthEstimate>>, StereoError> {
        for stage in self.since(stage) {
            if let Some(estimate) = self.sound(number, stage)? {
                return Ok(Some(estimate));
            }
        }
        Ok(None)
    }
}

/// How many views of at most so many pixels are worked on at once where as many as `most` would keep the engine busy.
fn at_once(pixels: usize, most: usize) -> usize {
    (PIXELS_AT_ONCE / pixels).clamp(1, most)
}

#[cfg(test)]
mod tests {
    use super::at_once;

    #[test]
    fn large_views_are_worked_on_one_by_one() {
        assert_eq!(
            [640 * 480, 1600 * 1067, 3200 * 2400].map(|pixels| at_once(pixels, 4)),
            [4, 2, 1]
        );
        assert_eq!(at_once(640 * 480, 2), 2);
    }
}

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use rayon::prelude::*;

use super::anchor::{Anchor, labels_of};
use super::choose::{anchors_for, fillers_for};
use super::complete::Completion;
use super::lookup::ask;
use super::options::CarryOptions;
use super::target::decide;
use super::tolerance::Tolerance;
use super::viewpoint::{Stand, Viewpoint};
use super::views::Views;
use super::vote::Votes;
use crate::engine::job::Progress;
use crate::masks::{Direction, LabelId, LabelMask, MaskError, TrackRequest, TrackedFrame, Tracker};

/// Carries masks between the frames of a static scene that have depth and cameras: what an anchor's mask says of a
/// surface, it says of it in every frame that sees it.
#[derive(Debug, Clone, Copy, Default)]
pub struct GeometryTracker {
    /// How masks are carried.
    pub options: CarryOptions,
}

/// Anchors kept ready at once.
const ANCHORS_READY: usize = 32;
/// Frames carried before their masks are handed on.
const CHUNK: usize = 8;

impl Tracker for GeometryTracker {
    fn name(&self) -> &'static str {
        "geometry"
    }

    fn track(
        &self,
        request: &TrackRequest,
        emit: &mut dyn FnMut(TrackedFrame),
        progress: &Progress,
    ) -> Result<Vec<String>, MaskError> {
        progress.stage("track")?;
        let views = Views::new(&request.frames, &request.store);
        let run = Run::new(&self.options, request, &views, progress)?;
        run.emit_all(emit)?;
        Ok(run.warnings)
    }
}

/// An anchor before its depth is loaded.
#[derive(Debug)]
struct Given {
    frame: usize,
    stand: Stand,
    labels: Vec<LabelId>,
    mask: Arc<LabelMask>,
}

/// One run of the tracker.
struct Run<'a> {
    options: &'a CarryOptions,
    request: &'a TrackRequest,
    views: &'a Views<'a>,
    progress: &'a Progress,
    anchors: Vec<Given>,
    targets: Vec<usize>,
    warnings: Vec<String>,
    ready: Mutex<Vec<(usize, Arc<Anchor>)>>,
    done: AtomicUsize,
}

impl<'a> Run<'a> {
    fn new(
        options: &'a CarryOptions,
        request: &'a TrackRequest,
        views: &'a Views<'a>,
        progress: &'a Progress,
    ) -> Result<Self, MaskError> {
        let mut anchors = Vec::new();
        for (&frame, mask) in &request.anchors {
            let Some(stand) = views.stand(frame) else { continue };
            anchors.push(Given { frame, stand, labels: labels_of(mask), mask: mask.clone() });
        }
        let targets: Vec<usize> = (request.from..=request.to).filter(|k| !request.anchors.contains_key(k)).collect();
        Ok(Self {
            options,
            request,
            views,
            progress,
            anchors,
            targets,
            warnings: Vec::new(),
            ready: Mutex::default(),
            done: AtomicUsize::new(0),
        })
    }

    fn emit_all(&self, emit: &mut dyn FnMut(TrackedFrame)) -> Result<(), MaskError> {
        for chunk in self.targets.chunks(CHUNK) {
            let answers: Vec<Result<Option<TrackedFrame>, MaskError>> =
                chunk.par_iter().map(|&frame| self.carry_to(frame)).collect();
            for answer in answers {
                if let Some(answer) = answer? {
                    emit(answer);
                }
            }
        }
        Ok(())
    }

    fn carry_to(&self, frame: usize) -> Result<Option<TrackedFrame>, MaskError> {
        self.progress.check()?;
        let Some(target) = self.views.load(frame)? else { return Ok(None) };
        let image = self.views.store.image(&self.views.frames[frame])?;
        let tolerance = self.tolerance(&target);
        let mut votes = Votes { width: target.width(), height: target.height(), of_anchors: Vec::new() };
        for given in self.anchors_for(frame, &target) {
            let Some(anchor) = self.anchor(given)? else { continue };
            let tolerance = Tolerance::measured(&target, &anchor.view, self.options);
            let sightings = ask(&anchor, &target, &tolerance, self.options, self.progress)?;
            votes.of_anchors.push((anchor, sightings));
        }
        let (mask, confidence) = decide(&votes, &target, &image, &tolerance, self.options, self.progress)?;
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        self.progress.step(done, self.targets.len())?;
        Ok(Some(TrackedFrame { frame, mask, confidence }))
    }

    fn tolerance(&self, view: &Viewpoint) -> Tolerance {
        Tolerance::new(self.options.most_tolerance, view.median_depth().unwrap_or(1.0))
    }

    fn anchors_for(&self, frame: usize, target: &Viewpoint) -> Vec<&Given> {
        let allowed: Vec<&Given> = self
            .anchors
            .iter()
            .filter(|anchor| match self.request.direction {
                Direction::Both => true,
                Direction::Forward => anchor.frame < frame,
                Direction::Backward => anchor.frame > frame,
            })
            .collect();
        let stands: Vec<(Stand, &[LabelId])> = allowed.iter().map(|a| (a.stand, a.labels.as_slice())).collect();
        anchors_for(target, &stands, self.options.anchors).into_iter().map(|place| allowed[place]).collect()
    }

    /// An anchor made ready, or kept from before.
    fn anchor(&self, given: &Given) -> Result<Option<Arc<Anchor>>, MaskError> {
        let kept =
            |ready: &[(usize, Arc<Anchor>)]| ready.iter().find(|(f, _)| *f == given.frame).map(|(_, a)| a.clone());
        let lock = || self.ready.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(anchor) = kept(&lock()) {
            return Ok(Some(anchor));
        }
        let Some(own) = self.views.load(given.frame)? else { return Ok(None) };
        let mut completion = Completion::new(&own, self.tolerance(&own));
        let others = (0..self.views.frames.len()).filter(|&f| f != given.frame);
        let others = others.filter_map(|f| Some((f, self.views.stand(f)?)));
        for filler in fillers_for(&own, others, self.options.fillers) {
            if let Some(filler) = self.views.load(filler)? {
                completion.add(&filler, self.progress)?;
            }
        }
        let filled = completion.finish();
        let anchor = Arc::new(Anchor::new(own, filled, given.mask.clone(), self.options));
        let mut ready = lock();
        if kept(&ready).is_none() {
            if ready.len() >= ANCHORS_READY {
                ready.remove(0);
            }
            ready.push((given.frame, anchor.clone()));
        }
        Ok(Some(anchor))
    }
}

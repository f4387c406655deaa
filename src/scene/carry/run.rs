use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use super::anchor::labels_of;
use super::choose::anchors_for;
use super::decide::decide;
use super::lookup::ask;
use super::options::CarryOptions;
use super::ready::{GivenAnchor, ReadyAnchors};
use super::tolerance::Tolerance;
use super::viewpoint::Stand;
use super::views::Views;
use super::vote::Votes;
use crate::engine::job::Progress;
use crate::masks::{Direction, LabelId, MaskError, TrackRequest, TrackedFrame};

/// Names listed in a message.
const NAMED: usize = 4;

/// One run of the tracker over a request.
pub struct Run<'a> {
    options: &'a CarryOptions,
    request: &'a TrackRequest,
    views: &'a Views<'a>,
    progress: &'a Progress,
    anchors: Vec<GivenAnchor<'a>>,
    ready: ReadyAnchors<'a>,
    /// Frames to carry to.
    targets: Vec<usize>,
    /// Anchors and frames without depth or camera.
    left_out: Vec<usize>,
    done: AtomicUsize,
}

impl<'a> Run<'a> {
    /// Checks the request.
    pub fn new(
        options: &'a CarryOptions,
        request: &'a TrackRequest,
        views: &'a Views<'a>,
        progress: &'a Progress,
    ) -> Result<Self, MaskError> {
        request.check()?;
        let mut left_out = Vec::new();
        let mut anchors = Vec::new();
        for (&frame, mask) in &request.anchors {
            match views.stand(frame) {
                Some(stand) => anchors.push(GivenAnchor { frame, stand, labels: labels_of(mask), mask }),
                None => left_out.push(frame),
            }
        }
        check_anchors(&anchors)?;
        let reached = |&frame: &usize| anchors.iter().any(|a| reaches(request.direction, a.frame, frame));
        let others = (request.from..=request.to).filter(|frame| !request.anchors.contains_key(frame));
        let (targets, without): (Vec<usize>, Vec<usize>) =
            others.filter(reached).partition(|&frame| views.stand(frame).is_some());
        left_out.extend(without);
        if targets.is_empty() {
            return Err(MaskError::Request(format!(
                "no frame from {} to {} besides the anchors has depth and a camera that masks could be carried to",
                request.from, request.to
            )));
        }
        let ready = ReadyAnchors::new(views, options);
        let done = AtomicUsize::new(0);
        Ok(Self { options, request, views, progress, anchors, ready, targets, left_out, done })
    }

    /// Carries to all targets, handing them on in order; what was finished is handed on even if a later one fails.
    pub fn carry_all(&self, emit: &mut dyn FnMut(TrackedFrame)) -> Result<(), MaskError> {
        for chunk in self.targets.chunks(4 * rayon::current_num_threads()) {
            let answers: Vec<Result<TrackedFrame, MaskError>> =
                chunk.par_iter().map(|&frame| self.carry_to(frame)).collect();
            let mut failed = None;
            for answer in answers {
                match answer {
                    Ok(tracked) => emit(tracked),
                    Err(error) => failed = failed.or(Some(error)),
                }
            }
            failed.map_or(Ok(()), Err)?;
        }
        Ok(())
    }

    /// One line that names the frames which were left out.
    pub fn warnings(&self) -> Vec<String> {
        let Some((first, rest)) = self.left_out.split_at_checked(NAMED.min(self.left_out.len())) else {
            return Vec::new();
        };
        if first.is_empty() {
            return Vec::new();
        }
        let names: Vec<&str> = first.iter().map(|&frame| self.request.frames[frame].name.as_str()).collect();
        let more = if rest.is_empty() { String::new() } else { format!(" and {} more", rest.len()) };
        let names = names.join(", ");
        vec![format!("{} frames were left out for want of depth or a camera: {names}{more}", self.left_out.len())]
    }

    fn carry_to(&self, frame: usize) -> Result<TrackedFrame, MaskError> {
        let target = self.views.load(frame)?;
        let image = self.views.image(frame)?;
        let mut votes = Votes { width: target.width(), height: target.height(), of_anchors: Vec::new() };
        let mut depths = target.depth.depths.clone();
        let allowed = |a: &&GivenAnchor<'_>| reaches(self.request.direction, a.frame, frame);
        let allowed: Vec<&GivenAnchor<'_>> = self.anchors.iter().filter(allowed).collect();
        let stands: Vec<(Stand, &[LabelId])> = allowed.iter().map(|a| (a.stand, a.labels.as_slice())).collect();
        for place in anchors_for(&target, &stands, self.options.anchors) {
            let anchor = self.ready.get(allowed[place], self.progress)?;
            let tolerance = Tolerance::measured(&target, &anchor.view, self.options);
            let sightings = ask(&anchor, &target, &tolerance, &mut depths, self.options, self.progress)?;
            votes.of_anchors.push((anchor, sightings));
        }
        let (mask, confidence) = decide(&votes, (&target, &depths), &image, self.options, self.progress)?;
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        self.progress.step(done, self.targets.len())?;
        Ok(TrackedFrame { frame, mask, confidence, preliminary: false })
    }
}

/// Whether masks may go from an anchor to a frame.
fn reaches(direction: Direction, anchor: usize, frame: usize) -> bool {
    match direction {
        Direction::Both => true,
        Direction::Forward => anchor < frame,
        Direction::Backward => anchor > frame,
    }
}

fn check_anchors(anchors: &[GivenAnchor<'_>]) -> Result<(), MaskError> {
    if anchors.iter().all(|anchor| anchor.labels.is_empty()) {
        return Err(MaskError::Request(
            "the geometry tracker needs depth and a camera on a frame with a mask; \
             give them (--depth, --cameras) or choose another tracker"
                .into(),
        ));
    }
    Ok(())
}

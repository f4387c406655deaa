use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use super::options::CarryOptions;
use super::views::Views;
use super::witnesses::Witnesses;
use crate::engine::job::Progress;
use crate::masks::{MaskError, TrackRequest, TrackedFrame};

/// Names listed in a message.
const NAMED: usize = 4;

/// One run of the tracker over a request.
pub struct Run<'a> {
    request: &'a TrackRequest,
    progress: &'a Progress,
    witnesses: Witnesses<'a>,
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
        let mut witnesses = Witnesses::new(options, request, views);
        check_anchors(&witnesses)?;
        let others = (request.from..=request.to).filter(|frame| !request.anchors.contains_key(frame));
        let (targets, without): (Vec<usize>, Vec<usize>) =
            others.filter(|&frame| witnesses.reach(frame)).partition(|&frame| witnesses.can_tell_of(frame));
        let mut left_out = std::mem::take(&mut witnesses.left_out);
        left_out.extend(without);
        if targets.is_empty() {
            return Err(MaskError::Request(format!(
                "no frame from {} to {} besides the anchors has depth and a camera that masks could be carried to",
                request.from, request.to
            )));
        }
        let done = AtomicUsize::new(0);
        Ok(Self { request, progress, witnesses, targets, left_out, done })
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
        let told = self.witnesses.tell_of(frame, self.progress)?;
        let (mask, confidence) = self.witnesses.carry_to(frame, &told, self.progress)?;
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        self.progress.step(done, self.targets.len())?;
        Ok(TrackedFrame { frame, mask, confidence, preliminary: false })
    }
}

fn check_anchors(witnesses: &Witnesses<'_>) -> Result<(), MaskError> {
    if witnesses.are_mute() {
        return Err(MaskError::Request(
            "the geometry tracker needs depth and a camera on a frame with a mask; \
             give them (--depth, --cameras) or choose another tracker"
                .into(),
        ));
    }
    Ok(())
}

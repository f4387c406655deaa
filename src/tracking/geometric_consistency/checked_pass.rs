use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use rayon::prelude::*;

use super::check_mask::{CheckedMask, ConsistencyOptions, check_mask};
use crate::reprojection::{KeyframeViews, ReprojectedLabels};
use ostra_core::job::{Progress, Stopped};
use ostra_frames::Frame;
use ostra_masks::{
    Direction, LabelMask, MaskError, TrackRequest, TrackedFrame, Tracker, WalkedFrame,
};

/// Keyframe views to check against, and options of the check.
#[derive(Clone, Copy)]
pub struct Geometry<'a> {
    pub keyframe_views: &'a KeyframeViews<'a>,
    pub options: &'a ConsistencyOptions,
}

/// One pass of a tracker, checked against geometry frame by frame.
///
/// If an object drifted, the tracker is stopped and restarts with the corrected mask as a keyframe.
///
/// This is not a pass of the propagation driver. It runs a whole [`Tracker`] of any kind, including
/// those without passes. Such a tracker reads the frames itself, and only its emitted masks are
/// visible here.
pub struct CheckedPass<'a> {
    tracker: &'a dyn Tracker,
    /// Forward or backward request, including the corrected masks of restarts.
    request: TrackRequest,
    /// Frames still to come.
    pending: BTreeSet<usize>,
    /// Frames that the tracker skipped since its last start.
    passed: BTreeSet<usize>,
    /// Frame of the last restart.
    seeded: Option<usize>,
    keyframe_views: &'a KeyframeViews<'a>,
    ahead: EvidenceAhead<'a>,
    options: &'a ConsistencyOptions,
    progress: &'a Progress,
}

/// Result of a pass for one frame.
pub struct CheckedFrame {
    pub frame: usize,
    pub walked: WalkedFrame,
    /// Frames since the last start, at a keyframe or a corrected mask.
    pub steps: usize,
}

/// Receives the results of a pass.
pub type FrameSink<'a> = dyn FnMut(CheckedFrame) -> Result<(), Stopped> + 'a;

/// How a run of the tracker ended.
enum RunEnd {
    /// It was stopped at this frame, to restart from this mask.
    Seed(usize, LabelMask),
    /// It finished, with these warnings.
    Through(Vec<String>),
}

impl<'a> CheckedPass<'a> {
    /// Creates a pass to `targets`, which must not be empty; `request` has one direction.
    pub fn new(
        tracker: &'a dyn Tracker,
        request: TrackRequest,
        targets: BTreeSet<usize>,
        geometry: Geometry<'a>,
        progress: &'a Progress,
    ) -> Self {
        let Geometry {
            keyframe_views,
            options,
        } = geometry;
        let ahead = EvidenceAhead::new(keyframe_views);
        Self {
            tracker,
            request,
            pending: targets,
            passed: BTreeSet::new(),
            seeded: None,
            keyframe_views,
            ahead,
            options,
            progress,
        }
    }

    /// Runs to the end and returns the tracker's warnings.
    ///
    /// If the tracker fails after a restart, the reason is returned as a warning.
    ///
    /// # Errors
    /// Returns the tracker's error if it fails before any restart, or [`MaskError::Stopped`].
    pub fn follow(
        mut self,
        report: &mut ConsistencyReport,
        sink: &mut FrameSink<'_>,
    ) -> Result<Vec<String>, MaskError> {
        loop {
            match self.stretch(report, sink) {
                Ok(RunEnd::Seed(frame, mask)) => self.seed(frame, mask, report),
                Ok(RunEnd::Through(warnings)) => return Ok(warnings),
                Err(error) if self.seeded.is_none() || matches!(error, MaskError::Stopped(_)) => {
                    return Err(error);
                }
                Err(error) => return Ok(vec![error.to_string()]),
            }
        }
    }

    fn seed(&mut self, frame: usize, mask: LabelMask, report: &mut ConsistencyReport) {
        self.request.keyframes.insert(frame, Arc::new(mask));
        self.seeded = Some(frame);
        report.seeded.insert(frame);
        // A tracker that is stopped does not report the frames it skipped.
        report.passed.append(&mut self.passed);
        self.request.from = self.pending.first().copied().unwrap_or(frame);
        self.request.to = self.pending.last().copied().unwrap_or(frame);
    }

    /// Runs the tracker until it ends or an object drifts.
    fn stretch(
        &mut self,
        report: &mut ConsistencyReport,
        sink: &mut FrameSink<'_>,
    ) -> Result<RunEnd, MaskError> {
        let (tracker, request, part) = (self.tracker, self.request.clone(), self.progress.part());
        let mut taken: Result<Option<RunEnd>, MaskError> = Ok(None);
        let mut emit = |tracked: TrackedFrame| {
            if matches!(taken, Ok(None)) {
                taken = self.take(tracked, report, sink);
            }
            if !matches!(taken, Ok(None)) {
                part.stop();
            }
        };
        let ended = tracker.track(&request, &mut emit, &part);
        match taken? {
            Some(seed) => Ok(seed),
            None => ended.map(RunEnd::Through),
        }
    }

    fn take(
        &mut self,
        tracked: TrackedFrame,
        report: &mut ConsistencyReport,
        sink: &mut FrameSink<'_>,
    ) -> Result<Option<RunEnd>, MaskError> {
        let TrackedFrame {
            frame,
            mask,
            confidence,
            preliminary,
        } = tracked;
        if preliminary || !self.pending.contains(&frame) {
            return Ok(None);
        }
        self.pass(frame);
        let (tracked, steps) = (WalkedFrame { mask, confidence }, self.steps(frame));
        let held = match self.evidence(frame, report)? {
            Some(evidence) => {
                let transferred = || {
                    let transferred =
                        self.keyframe_views
                            .transfer_to(frame, &evidence, self.progress)?;
                    Ok(transferred.map(|transferred| transferred.mask))
                };
                let held = check_mask(tracked, &evidence, self.options, transferred)?;
                report.note(frame, held.corrected);
                held
            }
            None => CheckedMask::untouched(tracked),
        };
        let is_rested = self
            .seeded
            .is_none_or(|last| last.abs_diff(frame) > self.options.rest);
        let restarts = held.has_drifted && is_rested && !self.pending.is_empty();
        let seed = restarts.then(|| RunEnd::Seed(frame, held.walked.mask.clone()));
        sink(CheckedFrame {
            frame,
            walked: held.walked,
            steps,
        })?;
        Ok(seed)
    }

    /// Returns the re-projected labels of a frame.
    ///
    /// Returns `None` and notes the frame in the report if they are not available.
    fn evidence(
        &mut self,
        frame: usize,
        report: &mut ConsistencyReport,
    ) -> Result<Option<ReprojectedLabels>, MaskError> {
        let reported = match self.request.direction {
            Direction::Backward => {
                self.ahead
                    .take(frame, self.pending.iter().rev().copied(), self.progress)
            }
            _ => self
                .ahead
                .take(frame, self.pending.iter().copied(), self.progress),
        };
        match reported {
            Err(MaskError::Stopped(stopped)) => return Err(stopped.into()),
            Ok(Some(evidence)) => return Ok(Some(evidence)),
            Ok(None) => {}
            Err(error) => {
                report.unread = report.unread.take().or_else(|| Some(error.to_string()));
            }
        }
        report.left.insert(frame);
        Ok(None)
    }

    /// Marks a frame as done.
    ///
    /// Frames of the same size earlier in the pass will not come any more, because they could not
    /// be read.
    fn pass(&mut self, frame: usize) {
        let frames = &self.request.frames;
        let size = |frame: usize| (frames[frame].width, frames[frame].height);
        let is_forward = self.request.direction != Direction::Backward;
        let is_later = |other: usize| {
            if is_forward {
                other > frame
            } else {
                other < frame
            }
        };
        let (pending, passed): (BTreeSet<usize>, BTreeSet<usize>) =
            std::mem::take(&mut self.pending)
                .into_iter()
                .filter(|&other| other != frame)
                .partition(|&other| is_later(other) || size(other) != size(frame));
        self.pending = pending;
        self.passed.extend(passed);
    }

    /// Returns the number of frames since the pass last started.
    fn steps(&self, frame: usize) -> usize {
        let keyframes = &self.request.keyframes;
        let begun = match self.request.direction {
            Direction::Backward => keyframes.range(frame..).next(),
            _ => keyframes.range(..frame).next_back(),
        };
        begun.map_or(1, |(begun, _)| begun.abs_diff(frame))
    }
}

/// Re-projected labels of the coming frames, computed in batches of one frame per thread.
struct EvidenceAhead<'a> {
    keyframe_views: &'a KeyframeViews<'a>,
    ready: BTreeMap<usize, Result<Option<ReprojectedLabels>, MaskError>>,
}

impl<'a> EvidenceAhead<'a> {
    pub fn new(keyframe_views: &'a KeyframeViews<'a>) -> Self {
        Self {
            keyframe_views,
            ready: BTreeMap::new(),
        }
    }

    /// Returns the labels of a frame, and computes those of the next frames with it.
    ///
    /// Returns `None` if no keyframe gives evidence for the frame, or if it cannot be read.
    ///
    /// # Errors
    /// As [`KeyframeViews::evidence_for`].
    pub fn take(
        &mut self,
        frame: usize,
        next: impl Iterator<Item = usize>,
        progress: &Progress,
    ) -> Result<Option<ReprojectedLabels>, MaskError> {
        if !self.keyframe_views.can_give_evidence_for(frame) {
            return Ok(None);
        }
        if !self.ready.contains_key(&frame) {
            let next = next.filter(|&frame| self.keyframe_views.can_give_evidence_for(frame));
            let frames: Vec<usize> = [frame]
                .into_iter()
                .chain(next)
                .take(rayon::current_num_threads())
                .collect();
            let reported = frames
                .into_par_iter()
                .map(|frame| (frame, self.keyframe_views.evidence_for(frame, progress)));
            self.ready = reported.collect();
        }
        Ok(self.ready.remove(&frame).transpose()?.flatten())
    }
}

/// Maximum number of frame names in a message.
const NAMED: usize = 4;

/// Effects of geometry on a tracker's masks.
#[derive(Debug, Default)]
pub struct ConsistencyReport {
    /// Frames checked.
    pub held: BTreeSet<usize>,
    /// Corrected pixels by frame; with two passes, the larger number.
    pub corrected: BTreeMap<usize, usize>,
    /// Frames on which the tracker was restarted.
    pub seeded: BTreeSet<usize>,
    /// Frames that the tracker skipped before a restart.
    pub passed: BTreeSet<usize>,
    /// Unchecked frames: without depth or camera, or unreadable.
    pub left: BTreeSet<usize>,
    /// Message of the first frame that could not be read.
    pub unread: Option<String>,
}

impl ConsistencyReport {
    /// Records the corrections of a frame.
    pub fn note(&mut self, frame: usize, corrected: usize) {
        self.held.insert(frame);
        if corrected > 0 {
            let most = self.corrected.entry(frame).or_default();
            *most = corrected.max(*most);
        }
    }

    /// Returns the lines of the report.
    pub fn lines(&self, frames: &[Frame]) -> Vec<String> {
        let held = self.held.len();
        let mut lines = Vec::new();
        if self.corrected.is_empty() {
            lines.push(format!(
                "geometry agrees with the masks of all {held} compared frames"
            ));
        } else {
            let pixels: usize = self.corrected.values().sum();
            let names = names(self.corrected.keys(), frames);
            let count = self.corrected.len();
            lines.push(format!(
                "geometry corrected {pixels} pixels in {count} of {held} frames: {names}"
            ));
        }
        if !self.seeded.is_empty() {
            let names = names(self.seeded.iter(), frames);
            lines.push(format!(
                "objects whose mask had drifted were restarted in the tracker on {names}"
            ));
        }
        if !self.left.is_empty() {
            let (count, names) = (self.left.len(), names(self.left.iter(), frames));
            lines.push(format!(
                "{count} frames were not compared, as they have no depth or no camera: {names}"
            ));
        }
        if !self.passed.is_empty() {
            lines.push(format!(
                "the tracker gave no mask for {}",
                names(self.passed.iter(), frames)
            ));
        }
        lines.extend(self.unread.clone());
        lines
    }
}

/// Lists the first few frames by name, and how many more there are.
fn names<'a>(of: impl ExactSizeIterator<Item = &'a usize>, frames: &[Frame]) -> String {
    let more = of.len().saturating_sub(NAMED);
    let named: Vec<&str> = of
        .take(NAMED)
        .map(|&frame| frames[frame].name.as_str())
        .collect();
    let more = if more > 0 {
        format!(" and {more} more")
    } else {
        String::new()
    };
    named.join(", ") + &more
}

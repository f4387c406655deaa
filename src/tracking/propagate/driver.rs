use std::collections::{BTreeMap, BTreeSet};

use super::frames::{FrameReader, KnownMasks, LookAhead, PassFrame, Upcoming};
use super::pass_result::{KeptResult, PassResult, shown_labels};
use super::plan::{KeyframeUse, Pass, PropagationPlan, Section};
use ostra_core::job::Progress;
use ostra_masks::{Direction, LabelMask, MaskError, TrackRequest, TrackedFrame};

/// An engine that propagates masks from one frame to the next.
///
/// One object serves the passes of one [`Section`]. Its memory consists of Rust values of bounded
/// size; the networks behind it have no state.
pub(crate) trait MaskPropagator {
    /// Forgets all objects and starts a pass in this direction.
    fn start_pass(&mut self, direction: Direction);

    /// Accepts the labels of `mask` on a frame as given.
    ///
    /// The frame is the first of the pass, a later keyframe, or one on which labels appear for the
    /// first time. Labels that `mask` does not show keep their memory.
    fn add_keyframe(&mut self, frame: &PassFrame, mask: &LabelMask) -> Result<(), MaskError>;

    /// Learns from the keyframe at the other end of an interval.
    ///
    /// It is called right after the first keyframe of the pass was added.
    fn add_far_keyframe(&mut self, _frame: &PassFrame, _mask: &LabelMask) -> Result<(), MaskError> {
        Ok(())
    }

    /// Propagates the masks to the next frame of the pass.
    fn transfer_to(
        &mut self,
        frame: &PassFrame,
        ahead: &mut LookAhead<'_, '_>,
    ) -> Result<PassResult, MaskError>;

    /// Merges the results of the forward pass (`first`) and the backward pass.
    ///
    /// `nearness` is 1 at the keyframe of the forward pass and 0 at the other.
    fn merge(&self, first: &PassResult, second: &PassResult, nearness: f32) -> PassResult {
        first.merged(second, nearness)
    }

    /// Returns the mask of a result at the size of the frame's image.
    fn mask_of_frame(&self, answer: &PassResult, _width: u32, _height: u32) -> LabelMask {
        answer.mask.clone()
    }
}

/// Function that creates the engine of a section.
type MakePropagator<'a> = dyn Fn(&Section) -> Box<dyn MaskPropagator + 'a> + 'a;

/// Runs an engine forward and backward through the frames of a tracking request.
///
/// Results of frames that both passes reach are merged. See [`ostra_masks::Tracker::track`].
///
/// # Errors
/// As [`ostra_masks::Tracker::track`].
pub(crate) fn propagate(
    request: &TrackRequest,
    keyframe_use: KeyframeUse,
    emit: &mut dyn FnMut(TrackedFrame),
    progress: &Progress,
    make: &MakePropagator<'_>,
) -> Result<Vec<String>, MaskError> {
    progress.stage("track")?;
    request.check()?;
    let plan = PropagationPlan::new(request, keyframe_use)?;
    let mut run = PropagationRun {
        request,
        emit,
        progress,
        reader: FrameReader::new(request, progress),
        done: 0,
        total: plan.steps(),
        answered: BTreeSet::new(),
    };
    for section in &plan.sections {
        run.section(section, &mut *make(section))?;
    }
    if run.answered.is_empty()
        && let Some(failure) = run.reader.failure()
    {
        return Err(failure);
    }
    let is_missed = |frame: &usize| !run.answered.contains(frame);
    let missed: Vec<usize> = plan.targets().filter(is_missed).collect();
    Ok(run.reader.warnings(&missed, &plan.other_sizes))
}

struct PropagationRun<'a> {
    request: &'a TrackRequest,
    emit: &'a mut dyn FnMut(TrackedFrame),
    progress: &'a Progress,
    reader: FrameReader<'a>,
    done: usize,
    total: usize,
    /// Frames whose masks were emitted.
    answered: BTreeSet<usize>,
}

/// State of a section while an engine runs through it.
struct SectionRun<'s> {
    section: &'s Section,
    engine: &'s mut dyn MaskPropagator,
    /// Results of the forward pass, by frame, until the backward pass reaches them.
    kept: BTreeMap<usize, KeptResult>,
}

impl PropagationRun<'_> {
    /// Runs the engine forward, then backward.
    ///
    /// Results of the first pass are emitted at once, and again when the second pass has reached
    /// the frame.
    fn section(
        &mut self,
        section: &Section,
        engine: &mut dyn MaskPropagator,
    ) -> Result<(), MaskError> {
        let mut run = SectionRun {
            section,
            engine,
            kept: BTreeMap::new(),
        };
        self.pass(&mut run, Direction::Forward)?;
        self.pass(&mut run, Direction::Backward)?;
        // The keyframe at which the second pass should start could not be read.
        for (frame, answer) in std::mem::take(&mut run.kept) {
            if section.backward.targets.contains(&frame) {
                self.hand_on(run.engine, frame, &answer.unpacked(), false);
            }
        }
        Ok(())
    }

    /// Runs the engine through one pass. An unreadable keyframe starts no pass.
    fn pass(&mut self, run: &mut SectionRun<'_>, direction: Direction) -> Result<(), MaskError> {
        let section = run.section;
        let pass = section.pass(direction);
        if pass.frames.is_empty() {
            return Ok(());
        }
        run.engine.start_pass(direction);
        let kept = &run.kept;
        let known = KnownMasks {
            section,
            pass,
            kept,
        };
        let beyond = pass.beyond.filter(|&frame| known.get(frame).is_some());
        let mut upcoming = Upcoming::new(pass.frames.iter().copied().chain(beyond));
        let before = self.done;
        let mut previous = None;
        while let Some(frame) = upcoming.next(&mut self.reader)?
            && pass.beyond != Some(frame.index)
        {
            if let Some(mask) = section.keyframes.get(&frame.index) {
                run.engine.add_keyframe(&frame, mask)?;
                if previous.is_none() {
                    self.add_far_keyframe(run, pass)?;
                }
                previous = Some(frame.index);
            } else if let Some(from) = previous {
                let mut ahead = LookAhead {
                    upcoming: &mut upcoming,
                    reader: &mut self.reader,
                    known: KnownMasks {
                        section,
                        pass,
                        kept: &run.kept,
                    },
                    interval: section.interval_at(frame.index),
                    previous: from,
                };
                let answer = run.engine.transfer_to(&frame, &mut ahead)?;
                self.take(run, direction, frame.index, answer);
                previous = Some(frame.index);
            } else if !upcoming.has_keyframe(section) {
                break;
            }
            self.done = before + upcoming.passed().min(pass.frames.len());
            self.progress.step(self.done, self.total)?;
        }
        self.done = before + pass.frames.len();
        Ok(())
    }

    fn add_far_keyframe(&mut self, run: &mut SectionRun<'_>, pass: &Pass) -> Result<(), MaskError> {
        if let Some(far) = pass.far_keyframe
            && let Some(frame) = self.reader.read(far)?
        {
            run.engine
                .add_far_keyframe(&frame, &run.section.keyframes[&far])?;
        }
        Ok(())
    }

    /// Emits a result, merged with that of the other pass if there is one.
    fn take(
        &mut self,
        run: &mut SectionRun<'_>,
        direction: Direction,
        frame: usize,
        answer: PassResult,
    ) {
        let section = run.section;
        let is_target = section.pass(direction).targets.contains(&frame);
        if direction == Direction::Backward {
            if is_target {
                let answer = match run.kept.remove(&frame).zip(section.interval_at(frame)) {
                    Some((first, interval)) => {
                        let nearness = interval.nearness(frame);
                        run.engine.merge(&first.unpacked(), &answer, nearness)
                    }
                    None => answer,
                };
                self.hand_on(run.engine, frame, &answer, false);
            }
            return;
        }
        let is_met = section.backward.targets.contains(&frame);
        if is_target {
            self.hand_on(run.engine, frame, &answer, is_met);
        }
        if is_met || section.backward.beyond == Some(frame) {
            run.kept.insert(frame, KeptResult::new(answer));
        }
    }

    fn hand_on(
        &mut self,
        engine: &dyn MaskPropagator,
        frame: usize,
        answer: &PassResult,
        preliminary: bool,
    ) {
        let of = &self.request.frames[frame];
        let mask = engine.mask_of_frame(answer, of.width, of.height);
        let shown = shown_labels(&answer.mask);
        let confidence = answer.confidence.iter();
        let confidence = confidence.filter(|(label, _)| shown.contains(label));
        (self.emit)(TrackedFrame {
            frame,
            mask,
            confidence: confidence.map(|(&label, &value)| (label, value)).collect(),
            preliminary,
        });
        self.answered.insert(frame);
    }
}

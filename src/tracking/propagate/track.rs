use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::answer::Answer;
use super::course::{Course, Route};
use super::merge::merged;
use super::pictures::{Loading, Pictures};
use super::seam::{Propagated, Propagator};
use ostra_core::job::Progress;
use ostra_masks::{LabelMask, MaskError, RunMask, TrackRequest, TrackedFrame};

/// Makes a [`Propagator`] that has seen nothing yet.
pub(crate) type Make<'a> = dyn Fn() -> Box<dyn Propagator + 'a> + 'a;

/// What [`ostra_masks::Tracker::track`] is asked for, by propagators: one walks from the first anchor to the last frame and
/// takes over every anchor on its way, another walks back; where both come by, they are merged. Each picture size has its own
/// walks.
///
/// # Errors
/// As [`ostra_masks::Tracker::track`].
pub(crate) fn track(
    request: &TrackRequest,
    emit: &mut dyn FnMut(TrackedFrame),
    progress: &Progress,
    make: &Make<'_>,
) -> Result<Vec<String>, MaskError> {
    progress.stage("track")?;
    request.check()?;
    let (courses, others) = Course::all(request);
    let total = courses.iter().map(Course::steps).sum();
    if total == 0 {
        return Err(nothing_to_do(request, courses.is_empty()));
    }
    let pictures = Pictures::new(request, progress);
    let mut run = Run {
        emit,
        progress,
        make,
        pictures,
        done: 0,
        total,
        answered: BTreeSet::new(),
    };
    courses.iter().try_for_each(|course| run.follow(course))?;
    if let Some(failure) = run
        .answered
        .is_empty()
        .then(|| run.pictures.failure())
        .flatten()
    {
        return Err(failure);
    }
    let wanted = courses
        .iter()
        .flat_map(|course| course.forward.targets.union(&course.backward.targets));
    let missed: Vec<usize> = wanted
        .copied()
        .filter(|frame| !run.answered.contains(frame))
        .collect();
    Ok(run.pictures.warnings(&missed, &others))
}

fn nothing_to_do(request: &TrackRequest, is_unmasked: bool) -> MaskError {
    if is_unmasked {
        return MaskError::Request(
            "no mask shows a label that is to be tracked; prompt or import one first".into(),
        );
    }
    MaskError::Request(format!(
        "no frame from {} to {} lies on the side of an anchor that masks are carried to; choose another range or \
         direction",
        request.from, request.to
    ))
}

struct Run<'a, 'p> {
    emit: &'a mut dyn FnMut(TrackedFrame),
    progress: &'a Progress,
    make: &'a Make<'p>,
    pictures: Pictures<'a>,
    done: usize,
    total: usize,
    /// The frames that were handed on.
    answered: BTreeSet<usize>,
}

/// An answer of the walk forwards, kept until the walk backwards comes by.
struct Kept {
    runs: RunMask,
    /// Its mask is empty.
    rest: Answer,
}

impl Run<'_, '_> {
    fn follow(&mut self, course: &Course) -> Result<(), MaskError> {
        let mut kept: BTreeMap<usize, Kept> = BTreeMap::new();
        let met = &course.backward.targets;
        self.walk(
            &course.forward,
            &course.anchors,
            &mut |run, frame, given| {
                let answer = Answer::new(&given);
                run.hand_on(frame, &answer, met.contains(&frame));
                if met.contains(&frame) {
                    let runs = RunMask::encode(&answer.mask);
                    kept.insert(
                        frame,
                        Kept {
                            runs,
                            rest: Answer {
                                mask: LabelMask::empty(0, 0),
                                ..answer
                            },
                        },
                    );
                }
            },
        )?;
        self.walk(
            &course.backward,
            &course.anchors,
            &mut |run, frame, given| {
                let second = Answer::new(&given);
                let answer = match kept.remove(&frame) {
                    None => second,
                    Some(Kept { runs, rest }) => {
                        let first = Answer {
                            mask: runs.decode(),
                            ..rest
                        };
                        merged(&first, &second, &given, course.nearness(frame))
                    }
                };
                run.hand_on(frame, &answer, false);
            },
        )?;
        // The anchor behind them could not be read.
        for (frame, Kept { runs, rest }) in kept {
            self.hand_on(
                frame,
                &Answer {
                    mask: runs.decode(),
                    ..rest
                },
                false,
            );
        }
        Ok(())
    }

    fn walk(
        &mut self,
        route: &Route,
        anchors: &BTreeMap<usize, Arc<LabelMask>>,
        found: &mut dyn FnMut(&mut Self, usize, Propagated),
    ) -> Result<(), MaskError> {
        let mut propagator = (self.make)();
        let mut is_started = false;
        let mut loading = Loading::new(&route.frames);
        let before = self.done;
        while let Some((frame, image)) = loading.next(&mut self.pictures)? {
            if let Some(mask) = anchors.get(&frame) {
                propagator.remember(&image, mask)?;
                is_started = true;
            } else if is_started {
                let given = propagator.propagate(&image)?;
                if route.targets.contains(&frame) {
                    found(self, frame, given);
                }
            }
            self.done = before + loading.walked();
            self.progress.step(self.done, self.total)?;
        }
        self.done = before + route.frames.len();
        Ok(())
    }

    fn hand_on(&mut self, frame: usize, answer: &Answer, preliminary: bool) {
        let (mask, confidence) = (answer.mask.clone(), answer.confidences());
        (self.emit)(TrackedFrame {
            frame,
            mask,
            confidence,
            preliminary,
        });
        self.answered.insert(frame);
    }
}

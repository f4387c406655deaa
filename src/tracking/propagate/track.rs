use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::answer::{Answer, Propagated, Propagator, labels, merged};
use super::pictures::{Loading, Pictures};
use ostra_core::job::Progress;
use ostra_masks::{Direction, LabelId, LabelMask, MaskError, RunMask, TrackRequest, TrackedFrame};

/// Makes a [`Propagator`] that has seen nothing yet.
type Make<'a> = dyn Fn() -> Box<dyn Propagator + 'a> + 'a;

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

/// The walks over all frames of one picture size.
#[derive(Debug, PartialEq, Eq)]
struct Course {
    /// What anchors of that size show of the labels that are wanted; those that show none of them are left out.
    pub anchors: BTreeMap<usize, Arc<LabelMask>>,
    pub forward: Route,
    pub backward: Route,
}

/// One walk.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Route {
    /// Frames in the order of the walk: anchors that it starts from (for each label the nearest that shows it), then one
    /// frame after the other.
    pub frames: Vec<usize>,
    /// The frames that are to be answered.
    pub targets: BTreeSet<usize>,
}

impl Course {
    /// One for every picture size that an anchor has; second, the frames that were asked for but are of no such size.
    pub fn all(request: &TrackRequest) -> (Vec<Self>, Vec<usize>) {
        let size = |frame: usize| (request.frames[frame].width, request.frames[frame].height);
        let anchors = request
            .anchors
            .iter()
            .filter_map(|(&at, mask)| Some((at, wanted(mask, request.labels.as_ref())?)));
        let mut by_size: BTreeMap<(u32, u32), BTreeMap<usize, Arc<LabelMask>>> = BTreeMap::new();
        anchors.for_each(|(at, mask)| drop(by_size.entry(size(at)).or_default().insert(at, mask)));
        let asked =
            (request.from..=request.to).filter(|frame| !request.anchors.contains_key(frame));
        let (asked, others): (BTreeSet<usize>, BTreeSet<usize>) =
            asked.partition(|&at| by_size.contains_key(&size(at)));
        let course = |(of, anchors): ((u32, u32), BTreeMap<usize, Arc<LabelMask>>)| {
            let mut frames: Vec<usize> = (0..request.frames.len())
                .filter(|&frame| size(frame) == of)
                .collect();
            let route = |way, frames: &[usize]| match request.direction {
                direction if direction == way => Route::default(),
                _ => Route::new(frames, &anchors, &asked),
            };
            let forward = route(Direction::Backward, &frames);
            frames.reverse();
            let backward = route(Direction::Forward, &frames);
            Self {
                anchors,
                forward,
                backward,
            }
        };
        (
            by_size.into_iter().map(course).collect(),
            others.into_iter().collect(),
        )
    }

    /// Frames to be walked over.
    pub fn steps(&self) -> usize {
        self.forward.frames.len() + self.backward.frames.len()
    }

    /// How much the walk forwards counts in a frame that both answer, 0–1: all on its anchor, half between two.
    pub fn nearness(&self, frame: usize) -> f32 {
        let before = self
            .anchors
            .range(..frame)
            .next_back()
            .map_or(frame, |(&anchor, _)| frame - anchor);
        let after = self
            .anchors
            .range(frame..)
            .next()
            .map_or(frame, |(&anchor, _)| anchor - frame);
        after as f32 / (before + after).max(1) as f32
    }
}

impl Route {
    /// Along `frames`, to those of the `asked` that come after an anchor.
    fn new(
        frames: &[usize],
        anchors: &BTreeMap<usize, Arc<LabelMask>>,
        asked: &BTreeSet<usize>,
    ) -> Self {
        let mut nearest: BTreeMap<LabelId, usize> = BTreeMap::new();
        let (mut targets, mut ends) = (BTreeSet::new(), (0, 0));
        for (place, frame) in frames.iter().enumerate() {
            match anchors.get(frame) {
                Some(mask) if targets.is_empty() => {
                    nearest.extend(labels(mask).into_iter().map(|label| (label, place)));
                    ends.0 = place;
                }
                None if !nearest.is_empty() && asked.contains(frame) => {
                    targets.insert(*frame);
                    ends.1 = place;
                }
                _ => {}
            }
        }
        if targets.is_empty() {
            return Self::default();
        }
        let starts: BTreeSet<usize> = nearest.into_values().collect();
        let places = starts.into_iter().chain(ends.0 + 1..=ends.1);
        Self {
            frames: places.map(|place| frames[place]).collect(),
            targets,
        }
    }
}

/// What a mask shows of some labels; `None` where it shows nothing of them.
fn wanted(mask: &Arc<LabelMask>, chosen: Option<&BTreeSet<LabelId>>) -> Option<Arc<LabelMask>> {
    let shown = labels(mask);
    let is_chosen = |id: &LabelId| chosen.is_none_or(|chosen| chosen.contains(id));
    if shown.iter().all(is_chosen) {
        return (!shown.is_empty()).then(|| Arc::clone(mask));
    }
    if !shown.iter().any(is_chosen) {
        return None;
    }
    let ids = mask
        .ids
        .iter()
        .map(|id| if is_chosen(id) { *id } else { LabelId::NONE })
        .collect();
    Some(Arc::new(LabelMask { ids, ..**mask }))
}

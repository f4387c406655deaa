use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

use super::synthetic::Made;
use ostra_core::job::Progress;
use ostra_masks::{Direction, LabelId, LabelMask, MaskError, TrackRequest, TrackedFrame, Tracker};
use ostra_tracking::geometric_consistency::{ConsistencyOptions, ConsistencyTracker};

/// Corrupts a ground truth mask, given the number of frames since the tracker went wrong.
pub type Error = Box<dyn Fn(&LabelMask, usize) -> LabelMask + Send + Sync>;

/// Name of a frame for which the tracker gives no mask.
pub const UNREADABLE: &str = "unreadable";

/// A tracker that returns the ground truth, but goes wrong when it crosses a frame boundary.
///
/// The boundary is between frame `at - 1` and `at`, in either direction. The error lasts until the
/// tracker restarts beyond it.
pub struct Drift {
    truth: Arc<Vec<LabelMask>>,
    at: usize,
    error: Error,
    /// The frames that the tracker started from.
    begun: Arc<Mutex<Vec<usize>>>,
}

impl Tracker for Drift {
    fn name(&self) -> &'static str {
        "straying"
    }

    fn track(
        &self,
        request: &TrackRequest,
        emit: &mut dyn FnMut(TrackedFrame),
        progress: &Progress,
    ) -> Result<Vec<String>, MaskError> {
        let keyframes = &request.keyframes;
        let mut frames: Vec<usize> = (request.from..=request.to)
            .filter(|frame| !keyframes.contains_key(frame))
            .collect();
        let is_backward = request.direction == Direction::Backward;
        if is_backward {
            frames.reverse();
        }
        frames.retain(|&frame| request.frames[frame].name != UNREADABLE);
        for (done, &frame) in frames.iter().enumerate() {
            let before = keyframes
                .range(..frame)
                .next_back()
                .filter(|_| !is_backward);
            let begun = before.or_else(|| keyframes.range(frame..).next().filter(|_| is_backward));
            let Some((&begun, _)) = begun else { continue };
            let mut all = self.begun.lock().unwrap();
            if all.last() != Some(&begun) {
                all.push(begun);
            }
            drop(all);
            let has_passed = if is_backward {
                begun >= self.at && self.at > frame
            } else {
                begun < self.at && self.at <= frame
            };
            let truth = &self.truth[frame];
            let mask = if has_passed {
                (self.error)(truth, 1 + frame.abs_diff(self.at))
            } else {
                truth.clone()
            };
            let confidence = mask
                .ids
                .iter()
                .filter(|&&id| id != LabelId::NONE)
                .map(|&id| (id, 0.9))
                .collect();
            emit(TrackedFrame {
                frame,
                mask,
                confidence,
                preliminary: false,
            });
            progress.step(done + 1, frames.len())?;
        }
        Ok(vec!["a tracker's own warning".into()])
    }
}

/// Swaps two labels.
pub fn swap(a: LabelId, b: LabelId) -> Error {
    let swapped = move |id: LabelId| {
        if id == a {
            b
        } else if id == b {
            a
        } else {
            id
        }
    };
    Box::new(move |mask, _| LabelMask {
        ids: mask.ids.iter().map(|&id| swapped(id)).collect(),
        ..*mask
    })
}

/// Moves a label to the right, over everything else.
pub fn drift(label: LabelId, px: usize) -> Error {
    Box::new(move |mask, steps| {
        let (width, aside) = (mask.width as usize, px * steps);
        let came = |at: usize| at % width >= aside && mask.ids[at - aside] == label;
        let keeps = |id: LabelId| if id == label { LabelId::NONE } else { id };
        let ids = (0..mask.ids.len()).map(|at| if came(at) { label } else { keeps(mask.ids[at]) });
        LabelMask {
            ids: ids.collect(),
            ..*mask
        }
    })
}

/// Removes a label.
pub fn lose(label: LabelId) -> Error {
    let left = move |id: LabelId| if id == label { LabelId::NONE } else { id };
    Box::new(move |mask, _| LabelMask {
        ids: mask.ids.iter().map(|&id| left(id)).collect(),
        ..*mask
    })
}

/// Result of a constrained tracker.
pub struct Outcome {
    /// The last answer for each frame.
    pub tracked: BTreeMap<usize, TrackedFrame>,
    /// Number of answers, including preliminary ones.
    pub answers: usize,
    pub lines: Vec<String>,
    /// The frames that the tracker started from, in order.
    pub begun: Vec<usize>,
}

/// Returns a constrained tracker that goes wrong at a frame, and the frames it starts from.
pub fn constrained(
    made: &Made,
    at: usize,
    error: Error,
) -> (ConsistencyTracker, Arc<Mutex<Vec<usize>>>) {
    let begun = Arc::default();
    let tracker = Drift {
        truth: Arc::clone(&made.truth),
        at,
        error,
        begun: Arc::clone(&begun),
    };
    (
        ConsistencyTracker {
            tracker: Box::new(tracker),
            options: ConsistencyOptions::default(),
        },
        begun,
    )
}

/// Tracks a request with [`constrained`].
pub fn outcome(made: &Made, request: &TrackRequest, at: usize, error: Error) -> Outcome {
    let (tracker, begun) = constrained(made, at, error);
    let (mut tracked, mut answers) = (BTreeMap::new(), 0);
    let mut take = |frame: TrackedFrame| {
        answers += 1;
        tracked.insert(frame.frame, frame);
    };
    let lines = tracker
        .track(request, &mut take, &Progress::default())
        .unwrap();
    let begun = begun.lock().unwrap().clone();
    Outcome {
        tracked,
        answers,
        lines,
        begun,
    }
}

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::pass_result::shown_labels;
use ostra_masks::{Direction, LabelId, LabelMask, MaskError, TrackRequest};

/// How an engine uses the keyframes of a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum KeyframeUse {
    /// Every pass starts at one keyframe and ends before the next. Images may differ in size.
    Interval,
    /// A pass runs through all frames of one image size.
    ///
    /// It adds every keyframe on its way, so the engine's memory holds all of them.
    Sequence,
}

/// The frames that an engine runs through, section by section.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct PropagationPlan {
    pub sections: Vec<Section>,
    /// Requested frames whose image size differs from that of all keyframes.
    pub other_sizes: Vec<usize>,
}

/// Frames and their keyframes: an interval, or all frames of one image size.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Section {
    pub keyframes: BTreeMap<usize, Arc<LabelMask>>,
    pub forward: Pass,
    pub backward: Pass,
}

/// One pass through the frames of a section.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct Pass {
    /// Frames in the order of the pass; the first is a keyframe. Empty if there is no such pass.
    pub frames: Vec<usize>,
    /// The frames among them whose masks are emitted.
    pub targets: BTreeSet<usize>,
    /// The keyframe at the other end of an interval, which an engine may learn from in advance.
    pub far_keyframe: Option<usize>,
    /// The frame after the last one, which an engine may look ahead to if its mask is known.
    pub beyond: Option<usize>,
}

/// The keyframes on both sides of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct KeyframeInterval {
    pub before: usize,
    pub after: usize,
}

impl PropagationPlan {
    /// Plans the sections of a request.
    ///
    /// # Errors
    /// [`MaskError::Request`] if no frame can be reached.
    pub fn new(request: &TrackRequest, keyframe_use: KeyframeUse) -> Result<Self, MaskError> {
        let plan = match keyframe_use {
            KeyframeUse::Interval => Self::intervals(request),
            KeyframeUse::Sequence => Self::sequences(request)?,
        };
        if plan.steps() == 0 {
            return Err(MaskError::Request(format!(
                "no frame from {} to {} lies on the side of a keyframe to which masks are tracked; choose another range or \
                 direction",
                request.from, request.to
            )));
        }
        Ok(plan)
    }

    /// Returns the number of frames to process, counted once per pass.
    pub fn steps(&self) -> usize {
        let passes = self.sections.iter().flat_map(Section::passes);
        passes.map(|pass| pass.frames.len()).sum()
    }

    /// Returns the frames whose masks are emitted.
    pub fn targets(&self) -> impl Iterator<Item = usize> {
        let sections = self.sections.iter();
        sections.flat_map(|section| {
            section
                .forward
                .targets
                .union(&section.backward.targets)
                .copied()
        })
    }

    /// Plans one section for every run of frames between the same keyframes.
    fn intervals(request: &TrackRequest) -> Self {
        let mut intervals: Vec<RequestedInterval> = Vec::new();
        let is_requested = |frame: &usize| !request.keyframes.contains_key(frame);
        for frame in (request.from..=request.to).filter(is_requested) {
            let mut before = request
                .keyframes
                .range(..frame)
                .next_back()
                .map(|(&at, _)| at);
            let mut after = request.keyframes.range(frame..).next().map(|(&at, _)| at);
            before = before.filter(|_| request.direction != Direction::Backward);
            after = after.filter(|_| request.direction != Direction::Forward);
            match intervals.last_mut() {
                Some(interval) if interval.to + 1 == frame => interval.to = frame,
                _ if before.is_some() || after.is_some() => intervals.push(RequestedInterval {
                    from: frame,
                    to: frame,
                    before,
                    after,
                }),
                _ => {}
            }
        }
        Self {
            sections: intervals
                .iter()
                .map(|interval| interval.section(request))
                .collect(),
            other_sizes: Vec::new(),
        }
    }

    /// Plans one section for every image size of the keyframes.
    fn sequences(request: &TrackRequest) -> Result<Self, MaskError> {
        let size = |frame: usize| (request.frames[frame].width, request.frames[frame].height);
        let mut by_size: BTreeMap<(u32, u32), BTreeMap<usize, Arc<LabelMask>>> = BTreeMap::new();
        for (&at, mask) in &request.keyframes {
            if let Some(mask) = with_labels(mask, request.labels.as_ref()) {
                by_size.entry(size(at)).or_default().insert(at, mask);
            }
        }
        if by_size.is_empty() {
            return Err(MaskError::Request(
                "no mask shows a label that is to be tracked; prompt or import one first".into(),
            ));
        }
        let requested =
            (request.from..=request.to).filter(|frame| !request.keyframes.contains_key(frame));
        let (requested, others): (BTreeSet<usize>, BTreeSet<usize>) =
            requested.partition(|&at| by_size.contains_key(&size(at)));
        let mut sections = Vec::new();
        for (of, keyframes) in by_size {
            let mut frames: Vec<usize> = (0..request.frames.len())
                .filter(|&frame| size(frame) == of)
                .collect();
            let pass = |direction: Direction, frames: &[usize]| {
                let is_wanted = [Direction::Both, direction].contains(&request.direction);
                if is_wanted {
                    Pass::through(frames, &keyframes, &requested)
                } else {
                    Pass::default()
                }
            };
            let forward = pass(Direction::Forward, &frames);
            frames.reverse();
            let backward = pass(Direction::Backward, &frames);
            sections.push(Section {
                keyframes,
                forward,
                backward,
            });
        }
        Ok(Self {
            sections,
            other_sizes: others.into_iter().collect(),
        })
    }
}

/// Consecutive requested frames between the same keyframes.
struct RequestedInterval {
    from: usize,
    to: usize,
    /// The keyframes that their masks come from.
    before: Option<usize>,
    after: Option<usize>,
}

impl RequestedInterval {
    fn section(&self, request: &TrackRequest) -> Section {
        let keyframe = |&at: &usize| (at, Arc::clone(&request.keyframes[&at]));
        let forward = self.before.map(|before| Pass {
            frames: (before..=self.to).collect(),
            targets: (self.from..=self.to).collect(),
            far_keyframe: self.after,
            beyond: self.after.filter(|&after| after == self.to + 1),
        });
        let backward = self.after.map(|after| Pass {
            frames: (self.from..=after).rev().collect(),
            targets: (self.from..=self.to).collect(),
            far_keyframe: self.before,
            beyond: self.before.and_then(|_| self.from.checked_sub(1)),
        });
        Section {
            keyframes: self
                .before
                .iter()
                .chain(&self.after)
                .map(keyframe)
                .collect(),
            forward: forward.unwrap_or_default(),
            backward: backward.unwrap_or_default(),
        }
    }
}

impl Section {
    /// Returns the pass in a direction.
    pub(super) fn pass(&self, direction: Direction) -> &Pass {
        match direction {
            Direction::Backward => &self.backward,
            Direction::Forward | Direction::Both => &self.forward,
        }
    }

    fn passes(&self) -> [&Pass; 2] {
        [&self.forward, &self.backward]
    }

    /// Returns whether the section has both a forward and a backward pass.
    pub fn has_both_passes(&self) -> bool {
        self.passes().iter().all(|pass| !pass.frames.is_empty())
    }

    /// Returns the keyframes around a non-keyframe; `None` if one side has none.
    pub(super) fn interval_at(&self, frame: usize) -> Option<KeyframeInterval> {
        let (&before, _) = self.keyframes.range(..frame).next_back()?;
        let (&after, _) = self.keyframes.range(frame + 1..).next()?;
        Some(KeyframeInterval { before, after })
    }
}

impl Pass {
    /// Plans a pass along `frames` to those of `asked` that come after a keyframe.
    ///
    /// It starts at the keyframes before them: for each label, at the last one that shows it.
    fn through(
        frames: &[usize],
        keyframes: &BTreeMap<usize, Arc<LabelMask>>,
        requested: &BTreeSet<usize>,
    ) -> Self {
        let mut last_shown: BTreeMap<LabelId, usize> = BTreeMap::new();
        let mut targets = BTreeSet::new();
        let (mut last_start, mut last_target) = (0, 0);
        for (place, frame) in frames.iter().enumerate() {
            match keyframes.get(frame) {
                Some(mask) if targets.is_empty() => {
                    last_shown.extend(shown_labels(mask).into_iter().map(|label| (label, place)));
                    last_start = place;
                }
                None if !last_shown.is_empty() && requested.contains(frame) => {
                    targets.insert(*frame);
                    last_target = place;
                }
                _ => {}
            }
        }
        if targets.is_empty() {
            return Self::default();
        }
        let starts: BTreeSet<usize> = last_shown.into_values().collect();
        let places = starts.into_iter().chain(last_start + 1..=last_target);
        Self {
            frames: places.map(|place| frames[place]).collect(),
            targets,
            ..Self::default()
        }
    }
}

impl KeyframeInterval {
    /// Returns the proximity of a frame to the keyframe before: 1 at it, 0 at the one after.
    pub fn nearness(self, frame: usize) -> f32 {
        (self.after as f32 - frame as f32) / (self.after - self.before) as f32
    }

    /// Returns the weight of frame `other` relative to frame `own`, 0–1.
    ///
    /// The masks of the two frames come from different keyframes. Each counts by its proximity to
    /// its keyframe.
    pub fn share_of(self, other: usize, own: usize) -> f32 {
        let (of_other, of_own) = (self.nearness(other), self.nearness(own));
        let (other, own) = if other < own {
            (of_other, 1.0 - of_own)
        } else {
            (1.0 - of_other, of_own)
        };
        other / (other + own)
    }
}

/// Returns a mask with the chosen labels only; `None` if it shows none of them.
fn with_labels(
    mask: &Arc<LabelMask>,
    chosen: Option<&BTreeSet<LabelId>>,
) -> Option<Arc<LabelMask>> {
    let shown = shown_labels(mask);
    let is_chosen = |id: &LabelId| chosen.is_none_or(|chosen| chosen.contains(id));
    if shown.iter().all(is_chosen) {
        return (!shown.is_empty()).then(|| Arc::clone(mask));
    }
    if !shown.iter().any(is_chosen) {
        return None;
    }
    let kept = |id: &LabelId| if is_chosen(id) { *id } else { LabelId::NONE };
    Some(Arc::new(LabelMask {
        ids: mask.ids.iter().map(kept).collect(),
        ..**mask
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn section(keyframes: &[usize]) -> Section {
        let keyframe = |&at: &usize| (at, Arc::new(LabelMask::empty(1, 1)));
        Section {
            keyframes: keyframes.iter().map(keyframe).collect(),
            forward: Pass::default(),
            backward: Pass::default(),
        }
    }

    #[test]
    fn frame_nearer_to_its_keyframe_has_more_weight() {
        let interval = section(&[10, 18]).interval_at(11).unwrap();
        assert_eq!(
            interval,
            KeyframeInterval {
                before: 10,
                after: 18
            }
        );
        assert_eq!(
            [10, 14, 18].map(|frame| interval.nearness(frame)),
            [1.0, 0.5, 0.0]
        );
        assert_eq!(interval.share_of(10, 12), 0.8);
        assert_eq!(interval.share_of(13, 15), 0.5);
        assert_eq!(interval.share_of(18, 16), 0.8);
        let one_frame = section(&[10, 12]).interval_at(11).unwrap();
        assert_eq!(
            [one_frame.share_of(10, 12), one_frame.share_of(12, 10)],
            [0.5; 2]
        );
        assert_eq!(section(&[10]).interval_at(13), None);
    }
}

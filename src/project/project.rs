use std::collections::BTreeMap;
use std::ops::Bound;
use std::sync::Arc;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::{ResultKind, ResultRecord};
use ostra_frames::{Frame, FrameSet};
use ostra_masks::{LabelId, LabelTree, Prompt, RunMask};

/// All that is saved and undoable. It changes only through [`crate::Edit`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Project {
    /// Frames in the project's order; a frame's number is its place here and never changes.
    pub frames: Arc<Vec<Frame>>,
    /// What positions in the project are relative to, in the coordinates in which cameras were given; zero where these
    /// are small. Positions are kept in 32 bits, which cannot hold millimetres at the size of UTM or ECEF coordinates.
    pub origin: DVec3,
    /// The label tree.
    pub labels: LabelTree,
    /// What the user gave, by frame number and label.
    pub prompts: BTreeMap<(usize, LabelId), Prompt>,
    /// What the user said of labels over ranges of frames; none is empty.
    pub marks: BTreeMap<LabelId, Marks>,
    /// One mask per frame that has any.
    pub masks: BTreeMap<usize, FrameMask>,
    /// What was made from all that, and from which state.
    pub results: BTreeMap<ResultKind, ResultRecord>,
}

/// The mask of one frame, and where it comes from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FrameMask {
    /// The labels, run-length encoded; as large as the frame.
    #[serde(with = "crate::store::packed_runs")]
    pub runs: Arc<RunMask>,
    /// Anchors are never overwritten by a tracker.
    pub origin: MaskOrigin,
    /// Made from something that has changed since; kept until made anew. Never set on an anchor.
    #[serde(default)]
    pub stale: bool,
    /// Per label in it, how sure the tracker was, 0–1; empty for an anchor.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub confidence: BTreeMap<LabelId, f32>,
}

/// Where a mask comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MaskOrigin {
    /// Prompted, painted, corrected, imported or accepted by the user.
    Anchor,
    /// Carried here by a tracker.
    Tracked,
}

/// What the user said of a label over ranges of frames.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Marks {
    /// It is not there: no tracker may put it on these frames.
    #[serde(default, skip_serializing_if = "FrameSet::is_empty")]
    pub absent: FrameSet,
    /// Its pixels stay exactly as they are, whoever tracks, clicks or paints.
    #[serde(default, skip_serializing_if = "FrameSet::is_empty")]
    pub locked: FrameSet,
    /// Its pixels are kept but out of play: not drawn, not voted, not exported.
    #[serde(default, skip_serializing_if = "FrameSet::is_empty")]
    pub hidden: FrameSet,
}

impl Marks {
    /// Whether nothing was said.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.absent.is_empty() && self.locked.is_empty() && self.hidden.is_empty()
    }

    /// The highest frame that something is said of.
    #[must_use]
    pub fn last(&self) -> Option<usize> {
        [&self.absent, &self.locked, &self.hidden]
            .into_iter()
            .filter_map(FrameSet::last)
            .max()
    }
}

/// How good the masks probably are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Mean over labels and frames that have a mask of what the tracker made of itself, 0–1; an anchor counts 1.
    pub accuracy: f64,
    /// Frames with a mask.
    pub frames: usize,
}

impl Project {
    /// The anchors next to a frame: the last before it and the first after it.
    #[must_use]
    pub fn neighbour_anchors(&self, frame: usize) -> (Option<usize>, Option<usize>) {
        let is_anchor = |(_, mask): &(&usize, &FrameMask)| mask.origin == MaskOrigin::Anchor;
        let later = (Bound::Excluded(frame), Bound::Unbounded);
        let before = self.masks.range(..frame).rev().find(is_anchor);
        let after = self.masks.range(later).find(is_anchor);
        (
            before.map(|(&number, _)| number),
            after.map(|(&number, _)| number),
        )
    }

    /// Estimates how good the masks are; `None` while no mask shows a label. `labels_on` says how many labels a frame
    /// shows.
    pub fn estimate(&self, labels_on: impl Fn(usize) -> usize) -> Option<Estimate> {
        let (mut sum, mut count) = (0.0, 0usize);
        for (&frame, mask) in &self.masks {
            match mask.origin {
                MaskOrigin::Anchor => {
                    let shown = labels_on(frame);
                    (sum, count) = (sum + shown as f64, count + shown);
                }
                MaskOrigin::Tracked => {
                    sum += mask
                        .confidence
                        .values()
                        .map(|&sure| f64::from(sure))
                        .sum::<f64>();
                    count += mask.confidence.len();
                }
            }
        }
        (count > 0).then(|| Estimate {
            accuracy: sum / count as f64,
            frames: self.masks.len(),
        })
    }
}

#[cfg(test)]
mod tests {
    use crate::Edit;
    use crate::testing::{anchor, project, tracked};

    #[test]
    fn anchors_are_sure_and_empty_masks_say_nothing() {
        let mut project = project();
        assert_eq!(project.estimate(|_| 1), None);
        for (frame, mask) in [anchor([1, 2, 0]), tracked([1, 0, 0]), anchor([0; 3])]
            .into_iter()
            .enumerate()
        {
            project
                .apply(Edit::SetMask {
                    frame,
                    mask: Some(mask),
                })
                .unwrap();
        }
        let estimate = project.estimate(|frame| [2, 1, 0][frame]).unwrap();
        assert!((estimate.accuracy - 0.9).abs() < 1e-6, "{estimate:?}");
        assert_eq!(estimate.frames, 3);
    }
}

use std::collections::BTreeMap;
use std::ops::Bound;
use std::sync::Arc;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::{ResultKind, ResultRecord};
use ostra_frames::{Frame, FrameSet};
use ostra_masks::{LabelId, LabelTree, Prompt, RunMask};

/// All data that is saved and undoable; it changes only through [`crate::Edit`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Project {
    /// Frames in the project's order. A frame's number is its index here and never changes.
    pub frames: Arc<Vec<Frame>>,
    /// Origin of the project's positions, in the coordinates in which cameras were given.
    ///
    /// It is zero if those coordinates are small. Positions are stored in 32 bits, which cannot
    /// represent millimetres at the size of UTM or ECEF coordinates.
    pub origin: DVec3,
    /// The label tree.
    pub labels: LabelTree,
    /// Prompts of the user, by frame number and label.
    pub prompts: BTreeMap<(usize, LabelId), Prompt>,
    /// Marks of labels over ranges of frames; none is empty.
    pub marks: BTreeMap<LabelId, Marks>,
    /// Masks by frame number; frames without a mask are missing.
    pub masks: BTreeMap<usize, FrameMask>,
    /// Records of the results that were made from this data.
    pub results: BTreeMap<ResultKind, ResultRecord>,
}

/// The mask of one frame, and where it comes from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FrameMask {
    /// Label of each pixel, run-length encoded, at the size of the frame.
    #[serde(with = "crate::store::packed_runs")]
    pub runs: Arc<RunMask>,
    /// Origin of the mask. Trackers never overwrite keyframes.
    pub origin: MaskOrigin,
    /// Whether an input of the mask has changed since it was made. Never set on a keyframe.
    #[serde(default)]
    pub stale: bool,
    /// Tracker's confidence per label in the mask, 0–1; empty for a keyframe.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub confidence: BTreeMap<LabelId, f32>,
}

/// Origin of a mask.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MaskOrigin {
    /// Keyframe: prompted, painted, corrected, imported or accepted by the user.
    #[serde(rename = "anchor")] // the name in project files of format 1
    Keyframe,
    /// Propagated by a tracker.
    Tracked,
}

/// Statements of the user about a label over ranges of frames.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Marks {
    /// Frames on which the label does not occur, so trackers may not put it there.
    #[serde(default, skip_serializing_if = "FrameSet::is_empty")]
    pub absent: FrameSet,
    /// Frames on which no tracking, prompt or brush may change the label's pixels.
    #[serde(default, skip_serializing_if = "FrameSet::is_empty")]
    pub locked: FrameSet,
    /// Frames on which the label's pixels are kept but not drawn, voted or exported.
    #[serde(default, skip_serializing_if = "FrameSet::is_empty")]
    pub hidden: FrameSet,
}

impl Marks {
    /// Returns whether there are no marks.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.absent.is_empty() && self.locked.is_empty() && self.hidden.is_empty()
    }

    /// Returns the last frame that has any mark.
    #[must_use]
    pub fn last(&self) -> Option<usize> {
        [&self.absent, &self.locked, &self.hidden]
            .into_iter()
            .filter_map(FrameSet::last)
            .max()
    }
}

impl Project {
    /// Returns the last keyframe before a frame and the first one after it.
    #[must_use]
    pub fn neighbour_keyframes(&self, frame: usize) -> (Option<usize>, Option<usize>) {
        let is_keyframe = |(_, mask): &(&usize, &FrameMask)| mask.origin == MaskOrigin::Keyframe;
        let later = (Bound::Excluded(frame), Bound::Unbounded);
        let before = self.masks.range(..frame).rev().find(is_keyframe);
        let after = self.masks.range(later).find(is_keyframe);
        (
            before.map(|(&number, _)| number),
            after.map(|(&number, _)| number),
        )
    }
}

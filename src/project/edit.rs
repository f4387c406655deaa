use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::{FrameMask, Marks, ResultKind, ResultRecord};
use ostra_frames::{DepthSource, Frame, FrameCamera};
use ostra_masks::{Label, LabelId, Prompt};

/// "Set X to this": the only way a [`crate::Project`] changes. `Project::apply` returns the inverse.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Edit {
    /// Sets or takes out a label.
    SetLabel {
        /// Which.
        id: LabelId,
        /// `None` = take it out.
        label: Option<Label>,
    },
    /// Sets or takes out all that was given for a label on a frame.
    SetPrompt {
        /// Frame number.
        frame: usize,
        /// For which label.
        label: LabelId,
        /// `None` = nothing given.
        prompt: Option<Prompt>,
    },
    /// Sets or takes out a frame's mask.
    SetMask {
        /// Frame number.
        frame: usize,
        /// `None` = no mask.
        mask: Option<FrameMask>,
    },
    /// Marks tracked masks as made from something that has changed since, or takes the mark away. Frames without a
    /// tracked mask are passed over.
    SetStale {
        /// Frame numbers.
        frames: Vec<usize>,
        /// `true` = stale.
        stale: bool,
    },
    /// Sets what the user said of a label over ranges of frames.
    SetMarks {
        /// Of which label.
        label: LabelId,
        /// Empty = nothing was said.
        marks: Marks,
    },
    /// Sets the origin that coordinates are relative to. It moves nothing: cameras are set in the same step.
    SetOrigin {
        /// In the coordinates in which cameras were given.
        origin: DVec3,
    },
    /// Sets a frame's camera.
    SetCamera {
        /// Frame number.
        frame: usize,
        /// `None` = unknown.
        camera: Option<FrameCamera>,
    },
    /// Sets where a frame's depth comes from.
    SetDepth {
        /// Frame number.
        frame: usize,
        /// `None` = it has none.
        depth: Option<DepthSource>,
    },
    /// Puts frames at the end of the sequence.
    AddFrames {
        /// The new frames.
        frames: Vec<Frame>,
    },
    /// Takes the last frames away again (the inverse of [`Edit::AddFrames`]).
    DropFrames {
        /// How many remain.
        keep: usize,
    },
    /// Puts other sources in the place of frames' sources (moved pictures).
    SetFrame {
        /// Frame number.
        frame: usize,
        /// The frame as it shall be.
        value: Box<Frame>,
    },
    /// Sets or takes out a result's record.
    SetResult {
        /// Which result.
        kind: ResultKind,
        /// `None` = there is none.
        record: Option<ResultRecord>,
    },
}

impl Edit {
    /// The frame whose mask it sets or takes out.
    #[must_use]
    pub fn masked_frame(&self) -> Option<usize> {
        match self {
            Self::SetMask { frame, .. } => Some(*frame),
            _ => None,
        }
    }
}

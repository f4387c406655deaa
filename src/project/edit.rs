use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::{FrameMask, Marks, ResultKind, ResultRecord};
use ostra_frames::{DepthSource, Frame, FrameCamera};
use ostra_masks::{Label, LabelId, Prompt};

/// A change that sets one part of a [`crate::Project`] to a value.
///
/// Edits are the only way a project changes. `Project::apply` returns the inverse.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Edit {
    /// Sets or removes a label.
    SetLabel {
        /// Id of the label.
        id: LabelId,
        /// The label, or `None` to remove it.
        label: Option<Label>,
    },
    /// Sets or removes the prompt of a label on a frame.
    SetPrompt {
        /// Frame number.
        frame: usize,
        /// Label that is prompted.
        label: LabelId,
        /// The prompt, or `None` to remove it.
        prompt: Option<Prompt>,
    },
    /// Sets or removes a frame's mask.
    SetMask {
        /// Frame number.
        frame: usize,
        /// The mask, or `None` to remove it.
        mask: Option<FrameMask>,
    },
    /// Sets or clears the stale flag of tracked masks.
    ///
    /// Frames without a tracked mask are skipped.
    SetStale {
        /// Frame numbers.
        frames: Vec<usize>,
        /// Whether the masks are stale.
        stale: bool,
    },
    /// Sets the marks of a label.
    SetMarks {
        /// Label that is marked.
        label: LabelId,
        /// The marks; empty removes them.
        marks: Marks,
    },
    /// Sets the origin that coordinates are relative to.
    ///
    /// This does not move anything: the cameras are set in the same step.
    SetOrigin {
        /// The origin, in the coordinates in which cameras were given.
        origin: DVec3,
    },
    /// Sets a frame's camera.
    SetCamera {
        /// Frame number.
        frame: usize,
        /// The camera, or `None` if it is unknown.
        camera: Option<FrameCamera>,
    },
    /// Sets the source of a frame's depth.
    SetDepth {
        /// Frame number.
        frame: usize,
        /// The source, or `None` if the frame has no depth.
        depth: Option<DepthSource>,
    },
    /// Appends frames to the sequence.
    AddFrames {
        /// The new frames.
        frames: Vec<Frame>,
    },
    /// Removes the last frames (the inverse of [`Edit::AddFrames`]).
    DropFrames {
        /// Number of frames that remain.
        keep: usize,
    },
    /// Replaces a frame, for example because its image file was moved.
    SetFrame {
        /// Frame number.
        frame: usize,
        /// The new frame.
        value: Box<Frame>,
    },
    /// Sets or removes the record of a result.
    SetResult {
        /// Kind of the result.
        kind: ResultKind,
        /// The record, or `None` to remove it.
        record: Option<ResultRecord>,
    },
}

impl Edit {
    /// Returns the frame whose mask the edit sets or removes.
    #[must_use]
    pub fn masked_frame(&self) -> Option<usize> {
        match self {
            Self::SetMask { frame, .. } => Some(*frame),
            _ => None,
        }
    }
}

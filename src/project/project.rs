use std::collections::BTreeMap;
use std::sync::Arc;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::{Coordinates, FuseRequest, Marks};
use ostra_frames::Frame;
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

/// The results that a project can hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ResultKind {
    /// Masks carried through the sequence.
    Tracking,
    /// Camera poses.
    Cameras,
    /// Depth maps.
    Depths,
    /// The labelled cloud and its votes.
    Cloud,
}

/// How a result was made (provenance), and whether it still fits what it was made from.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ResultRecord {
    /// What made it, e.g. `geometry`, `given`, `fuse`.
    pub engine: String,
    /// Number of frames that took part.
    pub frames: usize,
    /// Wall time it took.
    pub seconds: f64,
    /// Made from something that has changed since.
    #[serde(default)]
    pub stale: bool,
    /// Options it was made with, for people to read.
    #[serde(default)]
    pub settings: String,
    /// Names the files that hold the result under `versions/`, so that undo brings the earlier one back; 0 = the
    /// result has no files of its own.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub version: u64,
    /// Edge of the voxels that the surface was made with, world units; `None` = the result has no surface.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub voxel: Option<f64>,
    /// A cloud's: a digest of all that its points were made of. While it stays, changed masks only vote again.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub geometry: Option<String>,
    /// What its lengths were multiplied by since it was made, by setting the scale; `None` = by nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scaled: Option<f64>,
    /// Of cameras and clouds: what their positions are measured in; `None` in records of older versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub coordinates: Option<Coordinates>,
    /// A cloud's: what was asked for, with lengths in the unit that it has now.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub request: Option<FuseRequest>,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands a reference")]
fn is_zero(version: &u64) -> bool {
    *version == 0
}

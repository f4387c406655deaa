//! What commands ask for.

use std::path::PathBuf;

use anyhow::{Result, ensure};
use glam::DVec2;
use serde::{Deserialize, Serialize};

use ostra_cloud::instances::InstanceOptions;
use ostra_cloud::select::SelectStep;
use ostra_masks::{Direction, LabelId, PxBox};
use ostra_project::{GrounderId, MaskOrigin, Project, SegmenterId, TrackerId};

/// What to look for by words.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GroundRequest {
    /// Frame number.
    pub frame: usize,
    /// Each of them names a class of things.
    pub phrases: Vec<String>,
    /// Least score of what is found, 0–1; chosen by the grounder when absent.
    #[serde(default)]
    pub threshold: Option<f32>,
    /// Grounder that searches.
    #[serde(default)]
    pub grounder: GrounderId,
}

/// Things that become labels, each an instance of its phrase's.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TakeRequest {
    /// Frame number.
    pub frame: usize,
    /// What each is, and the box around it.
    pub things: Vec<(String, PxBox)>,
    /// Segmenter that makes masks of the boxes.
    #[serde(default)]
    pub segmenter: SegmenterId,
}

/// A stroke on a frame's mask.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PaintRequest {
    /// Frame number.
    pub frame: usize,
    /// The label painted, or the one erased.
    pub label: LabelId,
    /// Corners of the stroke or polygon in pixels.
    pub points_px: Vec<DVec2>,
    /// Brush radius in pixels; 0 = the points are a polygon to fill.
    pub radius_px: f64,
    /// `true` takes the label away where the stroke goes.
    pub erase: bool,
    /// `true` = pixels of other labels are taken over too.
    pub replace: bool,
    /// `true` = the brush stops at the picture's edges on which the inner half of its radius does not lie; a polygon
    /// is filled as it is.
    #[serde(default)]
    pub snap: bool,
}

/// A border of a label pulled to where it belongs, on a frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PullRequest {
    /// Frame number.
    pub frame: usize,
    /// The label whose border is pulled.
    pub label: LabelId,
    /// Pulled from the place on its borders that is nearest to this, in pixels.
    pub from_px: DVec2,
    /// Where it is pulled to, in pixels.
    pub to_px: DVec2,
    /// `true` = pixels of other labels are taken over too.
    pub replace: bool,
}

/// A thin structure (stem, wire) on a frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TraceRequest {
    /// Frame number.
    pub frame: usize,
    /// The label that gets its pixels.
    pub label: LabelId,
    /// Two points along it or more, in pixels; it ends at the first and the last.
    pub points_px: Vec<DVec2>,
    /// `true` = pixels of other labels are taken over too.
    #[serde(default)]
    pub replace: bool,
}

/// Holes and islands of a label on a frame.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct TidyRequest {
    /// Frame number.
    pub frame: usize,
    /// The label; pixels of others stay.
    pub label: LabelId,
    /// Holes of fewer pixels are filled; 0 = none.
    #[serde(default)]
    pub holes_below_px: usize,
    /// Islands of fewer pixels are removed, never the largest piece; 0 = none.
    #[serde(default)]
    pub islands_below_px: usize,
}

/// How to track.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrackSettings {
    /// Tracker.
    pub tracker: TrackerId,
    /// First frame; none = 0.
    #[serde(default)]
    pub from: Option<usize>,
    /// Last frame (included); none = the last.
    #[serde(default)]
    pub to: Option<usize>,
    /// Which way.
    #[serde(default)]
    pub direction: Direction,
    /// Hold the masks against the anchors' masks carried through geometry.
    #[serde(default)]
    pub constrain: bool,
    /// Only these labels are taken from the tracker, every pixel of another label stays as it is; empty = all labels.
    #[serde(default)]
    pub labels: Vec<LabelId>,
    /// The chosen labels are written over others too.
    #[serde(default)]
    pub replace: bool,
    /// The run ends at the first frame on which it is less sure of a label than this, 0–1; none = it goes on.
    #[serde(default)]
    pub pause_below: Option<f32>,
    /// Shorter side of the pictures that a network sees, px, at least 64: more shows thinner things and takes longer; none =
    /// what it was evaluated with. For `xmem` and `deaot`.
    #[serde(default)]
    pub short_side: Option<u32>,
}

impl Default for TrackSettings {
    /// All labels over all frames, both ways, with the best tracker that is installed.
    fn default() -> Self {
        Self {
            tracker: TrackerId::Auto,
            from: None,
            to: None,
            direction: Direction::Both,
            constrain: false,
            labels: Vec::new(),
            replace: false,
            pause_below: None,
            short_side: None,
        }
    }
}

impl TrackSettings {
    /// The same from the anchor before `frame` to the anchor after it (both excluded; the sequence's end where there is
    /// none): what a correction of that frame can better.
    ///
    /// # Errors
    /// When the frame is not there or no anchor, or both its neighbours are anchors.
    pub fn around(self, project: &Project, frame: usize) -> Result<Self> {
        project.frame(frame)?;
        let is_anchor = project
            .masks
            .get(&frame)
            .is_some_and(|mask| mask.origin == MaskOrigin::Anchor);
        ensure!(
            is_anchor,
            "frame {frame} is no anchor; prompt, paint or accept its mask first"
        );
        let (before, after) = project.neighbour_anchors(frame);
        let from = before.map_or(0, |anchor| anchor + 1);
        let to = after.unwrap_or(project.frames.len()) - 1;
        ensure!(
            from < to,
            "around frame {frame} there is nothing to track: the frames next to it are anchors too"
        );
        Ok(Self {
            from: Some(from),
            to: Some(to),
            ..self
        })
    }
}

/// Which label is told apart into instances.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct InstancesRequest {
    /// The class; the instances become labels below it.
    pub label: LabelId,
    /// When points are one instance.
    #[serde(default)]
    pub options: InstanceOptions,
}

/// Which pieces without a label are adopted by what they hang on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct AdoptRequest {
    /// Points at most this many spacings (median distances between labelled neighbours) apart hang together, 1.5–20.
    pub radius: f64,
}

impl Default for AdoptRequest {
    fn default() -> Self {
        Self { radius: 3.0 }
    }
}

/// A correction in 3-D: points of the cloud are chosen, and every mask that sees them is changed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CloudCorrection {
    /// How the points are chosen, step by step.
    pub select: Vec<SelectStep>,
    /// What becomes of the pixels that see them.
    pub change: CloudChange,
    /// The frames that change become anchors; else each stays what it was, and a frame without a mask gets a tracked one.
    #[serde(default)]
    pub as_anchors: bool,
}

/// What a correction in 3-D does to the pixels that see the chosen points.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CloudChange {
    /// They become this label's.
    Assign(LabelId),
    /// They become nothing's.
    Clear,
}

impl CloudChange {
    /// The label that pixels get.
    #[must_use]
    pub fn label(self) -> LabelId {
        match self {
            Self::Assign(label) => label,
            Self::Clear => LabelId::NONE,
        }
    }
}

/// What is wanted of a network of the catalogue (or of ONNX Runtime).
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ModelRequest {
    /// Its name in the catalogue.
    pub name: String,
    /// What is to be done.
    pub task: ModelTask,
}

/// What can be done with a network of the catalogue.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ModelTask {
    /// Gets it from the net.
    Install,
    /// Takes it from files, or from a folder that holds them under the catalogue's names.
    Add(Vec<PathBuf>),
    /// Loads what is installed and holds it against what is expected.
    Check,
}

impl ModelRequest {
    /// Title of the job that does it.
    #[must_use]
    pub fn title(&self) -> String {
        let verb = match self.task {
            ModelTask::Install => "Install",
            ModelTask::Add(_) => "Add",
            ModelTask::Check => "Check",
        };
        format!("{verb} {}", self.name)
    }

    /// Whether both do the same to the same network.
    pub(crate) fn is_same_work(&self, other: &Self) -> bool {
        let task = std::mem::discriminant::<ModelTask>;
        self.name == other.name && task(&self.task) == task(&other.task)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ostra_project::Edit;
    use ostra_project::testing::{anchor, project, tracked};

    #[test]
    fn a_correction_reaches_from_anchor_to_anchor() {
        let mut project = project();
        let around = |project: &Project, frame| {
            let settings = TrackSettings::default().around(project, frame);
            settings
                .map(|settings| (settings.from.unwrap(), settings.to.unwrap()))
                .map_err(|error| error.to_string())
        };
        let set = |project: &mut Project, frame, mask| {
            project
                .apply(Edit::SetMask {
                    frame,
                    mask: Some(mask),
                })
                .unwrap()
        };
        set(&mut project, 1, anchor([1, 0, 0]));
        set(&mut project, 2, tracked([1, 0, 0]));
        assert_eq!(around(&project, 1), Ok((0, 4)));
        assert!(around(&project, 2).unwrap_err().contains("no anchor"));
        assert!(around(&project, 5).unwrap_err().contains("frames 0 to 4"));
        set(&mut project, 3, anchor([1, 0, 0]));
        assert_eq!(
            (around(&project, 1), around(&project, 3)),
            (Ok((0, 2)), Ok((2, 4)))
        );
        set(&mut project, 4, anchor([1, 0, 0]));
        set(&mut project, 2, anchor([1, 0, 0]));
        assert!(
            around(&project, 3)
                .unwrap_err()
                .contains("nothing to track")
        );
    }
}

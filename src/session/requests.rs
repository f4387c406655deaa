//! Requests that commands contain.

use std::path::PathBuf;

use anyhow::{Result, ensure};
use glam::DVec2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use ostra_cloud::instances::InstanceOptions;
use ostra_cloud::select::SelectStep;
use ostra_masks::{Direction, LabelId, PxBox};
use ostra_project::{GrounderId, MaskOrigin, Project, SegmenterId, TrackerId};

/// A search for objects by text.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FindByTextRequest {
    /// Frame number.
    pub frame: usize,
    /// Phrases, each of which names a class of objects.
    pub phrases: Vec<String>,
    /// Minimum score of found objects, 0–1; chosen by the grounder if absent.
    #[serde(default)]
    pub threshold: Option<f32>,
    /// Grounder that searches.
    #[serde(default)]
    pub grounder: GrounderId,
}

/// Objects that become labels, each an instance of the label of its phrase.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TakeRequest {
    /// Frame number.
    pub frame: usize,
    /// Phrase and bounding box of each object.
    pub things: Vec<(String, PxBox)>,
    /// Segmenter that makes masks from the boxes.
    #[serde(default)]
    pub segmenter: SegmenterId,
}

/// A stroke on a frame's mask.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PaintRequest {
    /// Frame number.
    pub frame: usize,
    /// Label to paint or to erase.
    pub label: LabelId,
    /// Points of the stroke or corners of the polygon, in pixels.
    #[schemars(with = "Vec<[f64; 2]>")]
    pub points_px: Vec<DVec2>,
    /// Brush radius in pixels; 0 means that the points are a polygon to fill.
    pub radius_px: f64,
    /// Whether the label is erased along the stroke.
    pub erase: bool,
    /// Whether pixels of other labels are overwritten.
    pub replace: bool,
    /// Whether the brush stops at image edges outside the inner half of its radius.
    ///
    /// A polygon is not affected.
    #[serde(default)]
    pub snap: bool,
}

/// A drag of a label's border on a frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct MoveBorderRequest {
    /// Frame number.
    pub frame: usize,
    /// Label whose border is dragged.
    pub label: LabelId,
    /// Start of the drag in pixels; it grabs the nearest point of the label's border.
    #[schemars(with = "[f64; 2]")]
    pub from_px: DVec2,
    /// End of the drag in pixels.
    #[schemars(with = "[f64; 2]")]
    pub to_px: DVec2,
    /// Whether pixels of other labels are overwritten.
    pub replace: bool,
}

/// A thin structure (stem, wire) on a frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TraceRequest {
    /// Frame number.
    pub frame: usize,
    /// Label that receives its pixels.
    pub label: LabelId,
    /// Two or more points along the structure, in pixels; it ends at the first and the last.
    #[schemars(with = "Vec<[f64; 2]>")]
    pub points_px: Vec<DVec2>,
    /// Whether pixels of other labels are overwritten.
    #[serde(default)]
    pub replace: bool,
}

/// Holes to fill and islands to remove in a label on a frame.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct CleanRequest {
    /// Frame number.
    pub frame: usize,
    /// Label to clean; pixels of other labels stay unchanged.
    pub label: LabelId,
    /// Holes with fewer pixels are filled; 0 fills none.
    #[serde(default)]
    pub holes_below_px: usize,
    /// Islands with fewer pixels are removed, except the largest piece; 0 removes none.
    #[serde(default)]
    pub islands_below_px: usize,
}

/// Settings of a tracking run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TrackSettings {
    /// Tracker.
    pub tracker: TrackerId,
    /// First frame; `None` means 0.
    #[serde(default)]
    pub from: Option<usize>,
    /// Last frame, inclusive; `None` means the last one.
    #[serde(default)]
    pub to: Option<usize>,
    /// Direction of tracking.
    #[serde(default)]
    pub direction: Direction,
    /// Whether the masks are checked against the keyframes' masks re-projected through geometry.
    #[serde(default)]
    pub constrain: bool,
    /// Labels that are tracked; all pixels of other labels stay unchanged. Empty means all labels.
    #[serde(default)]
    pub labels: Vec<LabelId>,
    /// Whether the chosen labels are written over others too.
    #[serde(default)]
    pub replace: bool,
    /// Confidence of a label, 0–1, below which the run pauses at the first such frame.
    ///
    /// `None` never pauses.
    #[serde(default)]
    pub pause_below: Option<f32>,
    /// Shorter side of the images for a network, in pixels, at least 64.
    ///
    /// A larger value shows thinner objects and takes longer. `None` means the size with which the
    /// network was evaluated.
    #[serde(default)]
    pub short_side: Option<u32>,
}

impl Default for TrackSettings {
    /// Returns the settings for all labels and frames, in both directions, with the best tracker.
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
    /// Limits the range to the frames between the keyframes before and after `frame`.
    ///
    /// Both keyframes are excluded. If there is none on one side, the range ends at the end of the
    /// sequence. A correction of `frame` can improve exactly these frames.
    ///
    /// # Errors
    ///
    /// Returns an error if the frame does not exist or is not a keyframe, or both its neighbours
    /// are keyframes.
    pub fn around(self, project: &Project, frame: usize) -> Result<Self> {
        project.frame(frame)?;
        let is_keyframe = project
            .masks
            .get(&frame)
            .is_some_and(|mask| mask.origin == MaskOrigin::Keyframe);
        ensure!(
            is_keyframe,
            "frame {frame} is not a keyframe; prompt, paint or accept its mask first"
        );
        let (before, after) = project.neighbour_keyframes(frame);
        let from = before.map_or(0, |keyframe| keyframe + 1);
        let to = after.unwrap_or(project.frames.len()) - 1;
        ensure!(
            from < to,
            "there is nothing to track around frame {frame}: the frames next to it are keyframes too"
        );
        Ok(Self {
            from: Some(from),
            to: Some(to),
            ..self
        })
    }
}

/// A label that is divided into instances.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct InstancesRequest {
    /// Label of the class; the instances become labels below it.
    pub label: LabelId,
    /// Options that decide which points are one instance.
    #[serde(default)]
    pub options: InstanceOptions,
}

/// Settings for assigning unlabelled pieces to the labelled object they are attached to.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct AttachRequest {
    /// Maximum distance of connected points as a multiple of the spacing, 1.5–20.
    ///
    /// The spacing is the median distance between labelled neighbours.
    pub radius: f64,
}

impl Default for AttachRequest {
    fn default() -> Self {
        Self { radius: 3.0 }
    }
}

/// A correction in 3-D: every mask that sees the selected points of the cloud is changed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CloudCorrection {
    /// Steps that select the points.
    pub select: Vec<SelectStep>,
    /// Change of the pixels that see them.
    pub change: CloudChange,
    /// Whether the frames that change become keyframes.
    ///
    /// Otherwise their origin stays the same, and a frame without a mask gets a tracked one.
    #[serde(default)]
    #[serde(alias = "as_anchors")]
    pub as_keyframes: bool,
}

/// A change of the pixels that see the selected points.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CloudChange {
    /// They get this label.
    Assign(LabelId),
    /// They become unlabelled.
    Clear,
}

impl CloudChange {
    /// Returns the label that the pixels get.
    #[must_use]
    pub fn label(self) -> LabelId {
        match self {
            Self::Assign(label) => label,
            Self::Clear => LabelId::NONE,
        }
    }
}

/// A task for a network of the catalogue (or for ONNX Runtime).
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct ModelRequest {
    /// Name in the catalogue.
    pub name: String,
    /// Task to perform.
    pub task: ModelTask,
}

/// A task for a network of the catalogue.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ModelTask {
    /// Downloads it, and tests it.
    Install(InstallRequest),
    /// Copies it from files, or from a folder that holds them under the catalogue's names.
    Add(Vec<PathBuf>),
    /// Loads the installed network, compares it with what is expected, and tests it.
    Check,
    /// Deletes its files.
    Remove,
}

/// What to download of a network.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct InstallRequest {
    /// Name of the variant; the recommended one if absent.
    pub variant: Option<String>,
    /// Whether the user accepts its licence.
    pub accept_licence: bool,
}

impl ModelRequest {
    /// Returns the title of the job.
    #[must_use]
    pub fn title(&self) -> String {
        let verb = match self.task {
            ModelTask::Install(_) => "Install",
            ModelTask::Add(_) => "Add",
            ModelTask::Check => "Check",
            ModelTask::Remove => "Remove",
        };
        format!("{verb} {}", self.name)
    }

    /// Returns whether both requests have the same task for the same network.
    pub(crate) fn is_same_work(&self, other: &Self) -> bool {
        let task = std::mem::discriminant::<ModelTask>;
        self.name == other.name && task(&self.task) == task(&other.task)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ostra_project::Edit;
    use ostra_project::testing::{keyframe, project, tracked};

    #[test]
    fn correction_affects_frames_between_the_neighbouring_keyframes() {
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
        set(&mut project, 1, keyframe([1, 0, 0]));
        set(&mut project, 2, tracked([1, 0, 0]));
        assert_eq!(around(&project, 1), Ok((0, 4)));
        assert!(around(&project, 2).unwrap_err().contains("not a keyframe"));
        assert!(around(&project, 5).unwrap_err().contains("frames 0 to 4"));
        set(&mut project, 3, keyframe([1, 0, 0]));
        assert_eq!(
            (around(&project, 1), around(&project, 3)),
            (Ok((0, 2)), Ok((2, 4)))
        );
        set(&mut project, 4, keyframe([1, 0, 0]));
        set(&mut project, 2, keyframe([1, 0, 0]));
        assert!(
            around(&project, 3)
                .unwrap_err()
                .contains("nothing to track")
        );
    }
}

use ostra_project::SegmenterId;
use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::requests::{
    AttachRequest, CleanRequest, CloudCorrection, FindByTextRequest, InstancesRequest,
    ModelRequest, MoveBorderRequest, PaintRequest, TakeRequest, TraceRequest, TrackSettings,
};
use ostra_frames::cameras::IntrinsicsSource;
use ostra_masks::{LabelId, MaskFormat};
use ostra_project::{
    ExportRequest, FuseRequest, PromptRequest, RangeRequest, ReconstructRequest, ScaleRequest,
};

/// A request to a [`Session`](crate::Session) from the window, command line or a recipe.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(
    description = "One step of a recipe: the name of a command, with its values if it has any."
)]
pub enum Command {
    /// Creates a project folder from sources and opens it.
    New(NewProject),
    /// Opens a project folder, for viewing if it cannot be written.
    Open(PathBuf),
    /// Opens a project folder for viewing, without writing to it.
    View(PathBuf),
    /// Opens a labelled PLY without a project, for inspection.
    Inspect(PathBuf),
    /// Closes the open project or PLY.
    Close,
    /// Appends frames to the sequence.
    AddFrames(NewProject),
    /// Updates the paths of frames whose sources have moved.
    Relocate {
        /// Folder (or video) that no longer exists.
        from: PathBuf,
        /// New path.
        to: PathBuf,
    },
    /// Creates a label.
    AddLabel {
        /// Name of the label.
        name: String,
        /// Name of the parent label.
        parent: Option<String>,
        /// Colour in sRGB; chosen automatically if absent.
        color: Option<[u8; 3]>,
    },
    /// Changes the name, colour or parent of a label.
    EditLabel(ostra_masks::Label),
    /// Removes a label with its prompts; its pixels become unlabelled.
    RemoveLabel(LabelId),
    /// Sets the prompt of a label on a frame and segments it.
    ///
    /// An empty prompt removes the label from the frame.
    Prompt(PromptRequest),
    /// Finds objects on a frame by text.
    Ground(FindByTextRequest),
    /// Creates labels and masks from found objects.
    TakeFound(TakeRequest),
    /// Applies a brush, eraser or polygon to a frame's mask; the frame becomes a keyframe.
    Paint(PaintRequest),
    /// Drags the border of a label on a frame; the frame becomes a keyframe.
    #[serde(alias = "pull")]
    MoveBorder(MoveBorderRequest),
    /// Assigns a thin structure through some points to a label; the frame becomes a keyframe.
    Trace(TraceRequest),
    /// Fills small holes of a label on a frame and removes its small islands.
    ///
    /// A frame that changes becomes a keyframe.
    #[serde(alias = "tidy")]
    Clean(CleanRequest),
    /// Makes a tracked frame a keyframe, with its mask unchanged.
    #[serde(alias = "make_anchor")]
    MakeKeyframe {
        /// Frame number.
        frame: usize,
    },
    /// Gives a frame the mask of the vote of all frames; it becomes a keyframe.
    AcceptVote {
        /// Frame number.
        frame: usize,
        /// Labels to take from the vote; empty means all.
        #[serde(default)]
        labels: Vec<LabelId>,
    },
    /// Creates a label for each instance of a class, from its connected parts in the cloud.
    Instances(InstancesRequest),
    /// Assigns unlabelled pieces of the cloud to the labelled object they are attached to.
    ///
    /// The masks change accordingly.
    #[serde(alias = "adopt")]
    Attach(AttachRequest),
    /// Assigns selected points of the cloud to another label.
    ///
    /// The pixels that see them change in all masks.
    CorrectCloud(CloudCorrection),
    /// Merges a label into another one: all pixels, clicks and points. The first label is removed.
    MergeLabels {
        /// Label to remove.
        label: LabelId,
        /// Label that receives its pixels, clicks and points.
        into: LabelId,
    },
    /// Removes a frame's mask and prompts.
    ClearMask {
        /// Frame number.
        frame: usize,
    },
    /// Changes labels over a range of frames.
    Range(RangeRequest),
    /// Reads masks from files; their frames become keyframes.
    ImportMasks {
        /// Folder of the masks.
        dir: PathBuf,
        /// Format of the files.
        format: MaskFormat,
    },
    /// Writes masks to files.
    ExportMasks {
        /// Folder of the masks.
        dir: PathBuf,
        /// Format of the files.
        format: MaskFormat,
        /// Whether files of an earlier export that were changed since are replaced.
        #[serde(default)]
        overwrite: bool,
    },
    /// Propagates the masks of keyframes through the sequence.
    Track(TrackSettings),
    /// Searches for unlabelled objects.
    Suggest,
    /// Suggests the objects that a segmenter proposes on a frame.
    Propose {
        /// Frame number.
        frame: usize,
        /// Segmenter that can propose objects.
        segmenter: SegmenterId,
    },
    /// Makes cameras and depths.
    Reconstruct(ReconstructRequest),
    /// Uses another one of the models that the images fall into; nothing connects them.
    SelectModel {
        /// Number of the model, from 1.
        model: usize,
    },
    /// Scales cameras and points to metres with a known length.
    Scale(ScaleRequest),
    /// Makes the labelled cloud.
    Fuse(FuseRequest),
    /// Writes results to files.
    Export(ExportRequest),
    /// Downloads, adds or checks a network; not part of the project or its recipe.
    Model(ModelRequest),
    /// Undoes the last step.
    Undo,
    /// Redoes the last undone step.
    Redo,
    /// Stops every running job; each keeps its results so far.
    Stop,
}

/// The frames to open, as for `ostra new` and `ostra add`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct NewProject {
    /// Folder of the project (not used by `add_frames`).
    pub root: PathBuf,
    /// Sources of frames with their depth folders, `every`, `from`, `to` and depth unit.
    pub open: ostra_frames::OpenRequest,
    /// File of cameras in a known format.
    #[serde(default)]
    pub cameras: Option<PathBuf>,
    /// Intrinsics that apply to every frame.
    #[serde(default)]
    pub intrinsics: Option<IntrinsicsSource>,
}

/// A list of commands that makes a project.
///
/// `ostra run` executes it, and the window can save it.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "OSTRA recipe")]
pub struct Recipe {
    /// Format of the file: 1.
    #[schemars(extend("const" = 1))]
    pub format: u32,
    /// Commands in order; each finishes before the next begins.
    pub commands: Vec<Command>,
}

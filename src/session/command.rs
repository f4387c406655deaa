use ostra_project::SegmenterId;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::requests::{
    AdoptRequest, CloudCorrection, GroundRequest, InstancesRequest, ModelRequest, PaintRequest,
    PullRequest, TakeRequest, TidyRequest, TraceRequest, TrackSettings,
};
use ostra_frames::cameras::IntrinsicsSource;
use ostra_masks::LabelId;
use ostra_project::{
    ExportRequest, FuseRequest, PromptRequest, RangeRequest, ReconstructRequest, ScaleRequest,
};

/// A request to a [`Session`](crate::Session) by window, command line or recipe.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Command {
    /// Makes a project folder from sources and opens it.
    New(NewProject),
    /// Opens a project folder; for viewing where it cannot be written.
    Open(PathBuf),
    /// Opens a project folder for viewing: nothing is written there.
    View(PathBuf),
    /// Opens a labelled PLY alone, for inspection.
    Inspect(PathBuf),
    /// Closes what is open.
    Close,
    /// Puts more frames at the end of the sequence.
    AddFrames(NewProject),
    /// Points frames whose source moved to its new place.
    Relocate {
        /// Folder (or film) that is gone.
        from: PathBuf,
        /// Where it is now.
        to: PathBuf,
    },
    /// Makes a label.
    AddLabel {
        /// Its name.
        name: String,
        /// Name of its parent.
        parent: Option<String>,
        /// sRGB; chosen when absent.
        color: Option<[u8; 3]>,
    },
    /// Changes a label's name, colour or parent.
    EditLabel(ostra_masks::Label),
    /// Takes a label out, with its prompts; its pixels become nothing.
    RemoveLabel(LabelId),
    /// Sets what is given for a label on a frame and segments it; an empty prompt takes the label off the frame.
    Prompt(PromptRequest),
    /// Looks for what words name on a frame.
    Ground(GroundRequest),
    /// Makes labels and masks of things that were found.
    TakeFound(TakeRequest),
    /// Brush, eraser or polygon on a frame's mask; the frame becomes an anchor.
    Paint(PaintRequest),
    /// Pulls the border of a label on a frame; the frame becomes an anchor.
    Pull(PullRequest),
    /// Gives a thin structure through some points to a label; the frame becomes an anchor.
    Trace(TraceRequest),
    /// Fills small holes of a label on a frame and removes its islands; a frame that changes becomes an anchor.
    Tidy(TidyRequest),
    /// Makes a tracked frame an anchor as it is.
    MakeAnchor {
        /// Frame number.
        frame: usize,
    },
    /// Gives a frame the mask that the vote of all frames has; it becomes an anchor.
    AcceptVote {
        /// Frame number.
        frame: usize,
        /// For these labels; all when none is named.
        #[serde(default)]
        labels: Vec<LabelId>,
    },
    /// Makes a label of each thing of a class, by what hangs together in the cloud.
    Instances(InstancesRequest),
    /// Gives pieces of the cloud without a label that hang on one labelled thing to it, in the masks, too.
    Adopt(AdoptRequest),
    /// Gives the pixels of all masks that see chosen points of the cloud to another label, and the points with them.
    CorrectCloud(CloudCorrection),
    /// All pixels, clicks and points of a label become another label's, and the label goes.
    MergeLabels {
        /// The label that goes.
        label: LabelId,
        /// The label that takes all it had.
        into: LabelId,
    },
    /// Takes a frame's mask and prompts away.
    ClearMask {
        /// Frame number.
        frame: usize,
    },
    /// Changes labels over a range of frames.
    Range(RangeRequest),
    /// Reads masks from files; their frames become anchors.
    ImportMasks {
        /// Folder.
        dir: PathBuf,
        /// `davis`, `binary`, `coco` or `yolo`.
        format: String,
    },
    /// Writes masks to files.
    ExportMasks {
        /// Folder.
        dir: PathBuf,
        /// `davis`, `binary`, `coco` or `yolo`.
        format: String,
        /// Replace files of an earlier export that were changed since.
        #[serde(default)]
        overwrite: bool,
    },
    /// Carries anchors' masks through the sequence.
    Track(TrackSettings),
    /// Looks for things that no label explains.
    Suggest,
    /// Offers what a segmenter takes for things on a frame.
    Propose {
        /// Frame number.
        frame: usize,
        /// Segmenter that can propose objects.
        segmenter: SegmenterId,
    },
    /// Makes cameras and depths.
    Reconstruct(ReconstructRequest),
    /// Gives cameras and points a unit by a known length.
    Scale(ScaleRequest),
    /// Makes the labelled cloud.
    Fuse(FuseRequest),
    /// Writes results to files.
    Export(ExportRequest),
    /// Gets, adds or checks a network; no part of the project or its recipe.
    Model(ModelRequest),
    /// Takes back the last step.
    Undo,
    /// Does the last step taken back again.
    Redo,
    /// Stops every running job; each keeps what it has.
    Stop,
}

impl Command {
    /// Whether it is work by hand on the masks: what a better segmenter or tracker would have saved.
    #[must_use]
    pub fn is_interaction(&self) -> bool {
        use Command as C;
        let on_a_frame = matches!(
            self,
            C::Prompt(_) | C::TakeFound(_) | C::Paint(_) | C::Pull(_) | C::Trace(_) | C::Tidy(_)
        );
        let in_space = matches!(self, C::CorrectCloud(_) | C::MergeLabels { .. });
        on_a_frame
            || in_space
            || matches!(
                self,
                C::Range(_) | C::MakeAnchor { .. } | C::AcceptVote { .. } | C::ClearMask { .. }
            )
    }
}

/// What to open, as `ostra new` and `ostra add` take it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NewProject {
    /// The project's folder (for `AddFrames`: ignored).
    pub root: PathBuf,
    /// Sources of frames with their depth folders, `every`, `from`, `to`, depth unit.
    pub open: ostra_frames::OpenRequest,
    /// Cameras in one of the formats known.
    #[serde(default)]
    pub cameras: Option<PathBuf>,
    /// The same for every frame.
    #[serde(default)]
    pub intrinsics: Option<IntrinsicsSource>,
}

/// A list of commands that makes a project: what `ostra run` takes and the window can save.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Recipe {
    /// Format of the file, 1.
    pub format: u32,
    /// In order; each is done before the next begins.
    pub commands: Vec<Command>,
}

use std::path::PathBuf;

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use crate::frames::cameras::{IntrinsicsSource, ModelEncoding};
use crate::masks::{Direction, LabelId, Prompt, PxBox};

/// A wish: all that window, command line and recipes can ask of a [`super::Session`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Command {
    /// Makes a project folder from sources and opens it.
    New(NewProject),
    /// Opens a project folder.
    Open(PathBuf),
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
    EditLabel(crate::masks::Label),
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
    },
    /// Carries anchors' masks through the sequence.
    Track(TrackSettings),
    /// Looks for things that no label explains.
    Suggest,
    /// Makes cameras and depths.
    Reconstruct(ReconstructRequest),
    /// Gives cameras and points a unit by a known length.
    Scale(ScaleRequest),
    /// Makes the labelled cloud.
    Fuse(FuseRequest),
    /// Writes results to files.
    Export(ExportRequest),
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
        let on_a_frame = matches!(self, C::Prompt(_) | C::TakeFound(_) | C::Paint(_) | C::Trace(_) | C::Tidy(_));
        on_a_frame || matches!(self, C::Range(_) | C::MakeAnchor { .. } | C::AcceptVote { .. } | C::ClearMask { .. })
    }
}

/// What to open, as `ostra new` and `ostra add` take it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NewProject {
    /// The project's folder (for `AddFrames`: ignored).
    pub root: PathBuf,
    /// Sources of frames with their depth folders, `every`, `from`, `to`, depth unit.
    pub open: crate::frames::OpenRequest,
    /// Cameras in one of the formats known.
    #[serde(default)]
    pub cameras: Option<PathBuf>,
    /// The same for every frame.
    #[serde(default)]
    pub intrinsics: Option<IntrinsicsSource>,
}

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
    /// Which grounder; `auto` = the best that is installed.
    #[serde(default = "auto")]
    pub grounder: String,
}

/// Things that become labels, each an instance of its phrase's.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TakeRequest {
    /// Frame number.
    pub frame: usize,
    /// What each is, and the box around it.
    pub things: Vec<(String, PxBox)>,
    /// Which segmenter makes masks of the boxes; `auto` = the best that is installed.
    #[serde(default = "auto")]
    pub segmenter: String,
}

/// A prompt for one label on one frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PromptRequest {
    /// Frame number.
    pub frame: usize,
    /// For which label.
    pub label: LabelId,
    /// All that is given (sets, not adds).
    pub prompt: Prompt,
    /// `auto`, `sam` or `builtin`.
    pub segmenter: String,
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

/// A change of labels over a range of frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RangeRequest {
    /// Which labels; none = all.
    pub labels: Vec<LabelId>,
    /// First frame.
    pub from: usize,
    /// Last frame (included).
    pub to: usize,
    /// What is done.
    pub change: RangeChange,
    /// Copied and interpolated labels are written over others too.
    #[serde(default)]
    pub replace: bool,
}

/// What can be done to labels over a range of frames.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RangeChange {
    /// They are not there: pixels and prompts go, and no tracker brings them back.
    Delete,
    /// They may be there again; trackers find them.
    Restore,
    /// Their pixels stay as they are, whoever tracks, clicks or paints.
    Lock,
    /// No longer so.
    Unlock,
    /// Kept, but neither drawn, voted nor exported.
    Hide,
    /// No longer so.
    Show,
    /// Their pixels and clicks become another label's.
    Merge {
        /// That label.
        into: LabelId,
    },
    /// One piece of the label becomes another label; on the other frames what lies nearer to it than to the rest.
    Split {
        /// Where the piece is pointed at.
        frame: usize,
        /// A pixel of the piece.
        at_px: DVec2,
        /// The piece's label.
        into: LabelId,
    },
    /// Between the first and the last frame of the range, shapes lie between theirs.
    Interpolate,
    /// As on another frame; the frames become anchors.
    Copy {
        /// That frame.
        frame: usize,
    },
}

/// How to track.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrackSettings {
    /// `auto`, `xmem`, `deaot`, `geometry` or `flow`.
    pub tracker: String,
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
            tracker: "auto".into(),
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

/// Where cameras and depths come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ReconstructMethod {
    /// What the frames allow: given poses and depths are kept.
    #[default]
    Auto,
    /// Cameras by structure from motion.
    Sfm,
    /// Depths by PatchMatch stereo.
    Mvs,
    /// Registration of RGB-D fragments.
    Rgbd,
}

/// How to make cameras and depths.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ReconstructRequest {
    /// Method.
    pub method: ReconstructMethod,
    /// Every n-th frame makes the reconstruction; the cameras of those between are placed in it.
    pub every: usize,
    /// `auto`, `cpu` or `gpu`.
    pub device: String,
    /// `auto`, `sift`, `xfeat` or `superpoint`.
    #[serde(default = "auto")]
    pub features: String,
    /// `auto`, `nearest`, `lighterglue` or `superglue`.
    #[serde(default = "auto")]
    pub matcher: String,
    /// `auto`, `fgr` or `ransac`: how fragments of an RGB-D recording that nothing else ties together are joined.
    #[serde(default = "auto")]
    pub registration: String,
    /// Longer sides are worked on at this many pixels; none = as large as the engine takes.
    #[serde(default)]
    pub max_side: Option<u32>,
    /// Only pixels with a label take part.
    #[serde(default)]
    pub only_labelled: bool,
    /// Pairs of frames that are matched besides those that are chosen.
    #[serde(default)]
    pub pairs: Vec<[usize; 2]>,
}

impl Default for ReconstructRequest {
    fn default() -> Self {
        Self {
            method: ReconstructMethod::Auto,
            every: 1,
            device: auto(),
            features: auto(),
            matcher: auto(),
            registration: auto(),
            max_side: None,
            only_labelled: false,
            pairs: Vec::new(),
        }
    }
}

fn auto() -> String {
    "auto".into()
}

/// A length that is known in the scene: a ruler, a marker, the distance of two points.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ScaleRequest {
    /// Its two ends.
    pub ends: [ScaleEnd; 2],
    /// How far they are apart, in the unit that the scene shall have.
    pub length: f64,
}

/// One end of a known length.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ScaleEnd {
    /// A point in world units as they are.
    World(DVec3),
    /// Where two frames or more see it: frame number and pixel.
    Seen(Vec<(usize, DVec2)>),
}

/// How to make the labelled cloud.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct FuseRequest {
    /// Edge of the voxel in world units; chosen from the data when absent.
    #[serde(default)]
    pub voxel: Option<f64>,
    /// Points whose label won less than this share of the votes are dropped.
    #[serde(default)]
    pub min_confidence: Option<f32>,
    /// Drop points without a label.
    #[serde(default)]
    pub drop_unlabelled: bool,
    /// Vote on the points of this cloud instead of making points.
    #[serde(default)]
    pub onto: Option<PathBuf>,
}

/// What to write where.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ExportRequest {
    /// Labelled PLY.
    #[serde(default)]
    pub cloud: Option<PathBuf>,
    /// Mesh: `.ply`, `.obj` or `.glb`.
    #[serde(default)]
    pub mesh: Option<PathBuf>,
    /// Voxels: `.ply`, `.npz` or `.vox`.
    #[serde(default)]
    pub voxels: Option<PathBuf>,
    /// COLMAP text model.
    #[serde(default)]
    pub cameras: Option<PathBuf>,
    /// Text or binary.
    #[serde(default)]
    pub camera_encoding: ModelEncoding,
    /// Pictures and masks without lens distortion, with their cameras.
    #[serde(default)]
    pub undistorted: Option<PathBuf>,
    /// Voxels are filled with what they enclose.
    #[serde(default)]
    pub solid: bool,
    /// Folder for the masks.
    #[serde(default)]
    pub masks: Option<PathBuf>,
    /// `davis` (palette PNGs and `labels.json`, when absent), `binary`, `coco` or `yolo`.
    #[serde(default)]
    pub mask_format: Option<String>,
    /// 32-bit float TIFFs.
    #[serde(default)]
    pub depths: Option<PathBuf>,
    /// Measured traits.
    #[serde(default)]
    pub traits: Option<PathBuf>,
    /// Read labels deeper than this as their ancestor there.
    #[serde(default)]
    pub level: Option<usize>,
    /// Write the same points in label colours beside the file.
    #[serde(default)]
    pub twin: bool,
    /// Write one file per label too.
    #[serde(default)]
    pub per_label: bool,
    /// Share of the mesh's triangles to keep, above 0, up to 1; all when absent.
    #[serde(default)]
    pub simplify: Option<f64>,
}

/// A list of commands that makes a project: what `ostra run` takes and the window can save.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Recipe {
    /// Format of the file, 1.
    pub format: u32,
    /// In order; each is done before the next begins.
    pub commands: Vec<Command>,
}

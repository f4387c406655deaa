use std::path::PathBuf;

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use crate::{DeviceId, FeatureId, MatcherId, RegistrationId, SegmenterId};
use ostra_cloud::measure::{GroundChoice, LengthUnit};
use ostra_frames::cameras::ModelEncoding;
use ostra_masks::{LabelId, Prompt};

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
    /// Where stereo runs.
    pub device: DeviceId,
    /// Feature detector.
    #[serde(default)]
    pub features: FeatureId,
    /// Feature matcher.
    #[serde(default)]
    pub matcher: MatcherId,
    /// Registration of fragments of an RGB-D recording that have no other link.
    #[serde(default)]
    pub registration: RegistrationId,
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
            device: DeviceId::Auto,
            features: FeatureId::Auto,
            matcher: MatcherId::Auto,
            registration: RegistrationId::Auto,
            max_side: None,
            only_labelled: false,
            pairs: Vec::new(),
        }
    }
}

/// A length that is known in the scene: a ruler, a marker, the distance of two points.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ScaleRequest {
    /// Its two ends.
    pub ends: [ScaleEnd; 2],
    /// How far they are apart, metres.
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
    /// Labelled cloud: `.ply`, `.las`, `.laz` or `.pcd`.
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
    /// The plane above which their heights are measured.
    #[serde(default)]
    pub ground: GroundChoice,
    /// Pairs of labels whose angle is told too, a row for each piece of the first.
    #[serde(default)]
    pub angles: Vec<[LabelId; 2]>,
    /// The unit of their lengths; that of the cloud when absent. A metric unit needs a scene whose scale is known.
    #[serde(default)]
    pub unit: Option<LengthUnit>,
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
    /// Replace files of an earlier export that were changed since. Sources and files that OSTRA did not write are never
    /// replaced.
    #[serde(default)]
    pub overwrite: bool,
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
    /// Segmenter that answers the prompt.
    pub segmenter: SegmenterId,
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

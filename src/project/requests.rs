use std::path::PathBuf;

use glam::{DVec2, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{DeviceId, FeatureId, MatcherId, RegistrationId, SegmenterId};
use ostra_cloud::formats::{CloudFormat, MeshFormat, VoxelFormat};
use ostra_cloud::measure::{GroundChoice, LengthUnit};
use ostra_frames::cameras::ModelEncoding;
use ostra_masks::{LabelId, MaskFormat, Prompt};

/// How cameras and depths are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ReconstructMethod {
    /// Automatic choice from what the frames provide; given poses and depths are kept.
    #[default]
    Auto,
    /// Cameras by structure from motion.
    Sfm,
    /// Depths by PatchMatch stereo.
    Mvs,
    /// Registration of RGB-D fragments.
    Rgbd,
}

/// Settings of a reconstruction of cameras and depths.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ReconstructRequest {
    /// Method.
    pub method: ReconstructMethod,
    /// Interval of the frames that are reconstructed.
    ///
    /// The cameras of the frames in between are registered to them.
    pub every: usize,
    /// Device that runs stereo.
    pub device: DeviceId,
    /// Feature detector.
    #[serde(default)]
    pub features: FeatureId,
    /// Feature matcher.
    #[serde(default)]
    pub matcher: MatcherId,
    /// Method that registers fragments of an RGB-D recording that have no other link.
    #[serde(default)]
    pub registration: RegistrationId,
    /// Maximum longer side of the images in pixels; `None` means the engine's maximum.
    #[serde(default)]
    pub max_side: Option<u32>,
    /// Whether only pixels with a label are used.
    #[serde(default)]
    pub only_labelled: bool,
    /// Additional pairs of frames to match.
    #[serde(default)]
    pub pairs: Vec<[usize; 2]>,
    /// Maximum size in GiB of the project's cache of features and matches; 0 keeps none.
    #[serde(default = "default_cache_limit_gib")]
    pub cache_limit_gib: u32,
}

/// Features of about 1,500 images with 8,192 each, with their matches.
const CACHE_LIMIT_GIB: u32 = 2;

fn default_cache_limit_gib() -> u32 {
    CACHE_LIMIT_GIB
}

impl ReconstructRequest {
    /// Returns the maximum size of the project's cache in bytes.
    #[must_use]
    pub fn cache_limit_bytes(&self) -> u64 {
        u64::from(self.cache_limit_gib) << 30
    }
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
            cache_limit_gib: CACHE_LIMIT_GIB,
        }
    }
}

/// A known length in the scene: a ruler, a marker, or the distance of two points.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ScaleRequest {
    /// Ends of the length.
    pub ends: [ScaleEnd; 2],
    /// Distance of the ends, in metres.
    pub length: f64,
}

/// One end of a known length.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ScaleEnd {
    /// A point, in the current world units.
    World(#[schemars(with = "[f64; 3]")] DVec3),
    /// Observations of the point in two or more frames: frame number and pixel.
    Seen(#[schemars(with = "Vec<(usize, [f64; 2])>")] Vec<(usize, DVec2)>),
}

/// Settings of the labelled cloud.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct FuseRequest {
    /// Edge length of the voxels in world units; chosen from the data if absent.
    #[serde(default)]
    pub voxel: Option<f64>,
    /// Minimum share of the votes for a point's label, 0–1; other points lose their label.
    #[serde(default)]
    pub min_confidence: Option<f32>,
    /// Whether points without a label are dropped.
    #[serde(default)]
    pub drop_unlabelled: bool,
    /// Cloud whose points are labelled by vote, instead of making points.
    #[serde(default)]
    pub onto: Option<PathBuf>,
}

/// Files to export.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct ExportRequest {
    /// Labelled cloud, in the [`CloudFormat`] of its ending.
    #[schemars(description = format!("Labelled cloud: {}.", CloudFormat::endings()))]
    #[serde(default)]
    pub cloud: Option<PathBuf>,
    /// Mesh, in the [`MeshFormat`] of its ending.
    #[schemars(description = format!("Mesh: {}.", MeshFormat::endings()))]
    #[serde(default)]
    pub mesh: Option<PathBuf>,
    /// Voxels, in the [`VoxelFormat`] of their ending.
    #[schemars(description = format!("Voxels: {}.", VoxelFormat::endings()))]
    #[serde(default)]
    pub voxels: Option<PathBuf>,
    /// COLMAP model.
    #[serde(default)]
    pub cameras: Option<PathBuf>,
    /// Encoding of the COLMAP model: text or binary.
    #[serde(default)]
    pub camera_encoding: ModelEncoding,
    /// Images and masks without lens distortion, with their cameras.
    #[serde(default)]
    pub undistorted: Option<PathBuf>,
    /// Whether the space that the voxels enclose is filled.
    #[serde(default)]
    pub solid: bool,
    /// Folder for the masks.
    #[serde(default)]
    pub masks: Option<PathBuf>,
    /// Format of the masks; `None` means `davis`.
    #[serde(default)]
    pub mask_format: Option<MaskFormat>,
    /// Folder for depth maps as 32-bit float TIFFs.
    #[serde(default)]
    pub depths: Option<PathBuf>,
    /// Measured traits.
    #[serde(default)]
    pub traits: Option<PathBuf>,
    /// Ground plane from which the heights of traits are measured.
    #[serde(default)]
    pub ground: GroundChoice,
    /// Pairs of labels whose angle is exported too, with one row for each piece of the first label.
    #[serde(default)]
    pub angles: Vec<[LabelId; 2]>,
    /// Unit of the trait lengths; that of the cloud if absent.
    ///
    /// A metric unit requires a scene whose scale is known.
    #[serde(default)]
    pub unit: Option<LengthUnit>,
    /// Maximum depth of labels; deeper labels are replaced by their ancestor at this depth.
    #[serde(default)]
    pub level: Option<usize>,
    /// Whether a copy of the cloud in label colours is written next to the file.
    #[serde(default)]
    pub twin: bool,
    /// Whether one more file per label is written.
    #[serde(default)]
    pub per_label: bool,
    /// Share of the mesh's triangles to keep, above 0 and at most 1; all if absent.
    #[serde(default)]
    pub simplify: Option<f64>,
    /// Whether files of an earlier export that were changed since are replaced.
    ///
    /// Sources and files that OSTRA did not write are never replaced.
    #[serde(default)]
    pub overwrite: bool,
}

/// A prompt for one label on one frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PromptRequest {
    /// Frame number.
    pub frame: usize,
    /// Label that is prompted.
    pub label: LabelId,
    /// Complete prompt; it replaces the current one.
    pub prompt: Prompt,
    /// Segmenter that answers the prompt.
    pub segmenter: SegmenterId,
}

/// A change of labels over a range of frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RangeRequest {
    /// Labels to change; empty means all.
    pub labels: Vec<LabelId>,
    /// First frame.
    pub from: usize,
    /// Last frame, inclusive.
    pub to: usize,
    /// The change.
    pub change: RangeChange,
    /// Whether copied and interpolated labels are written over other labels too.
    #[serde(default)]
    pub replace: bool,
}

/// A change of labels over a range of frames.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RangeChange {
    /// Removes pixels and prompts, and marks the labels as absent for trackers.
    Delete,
    /// Removes the absent mark, so that trackers may find the labels again.
    Restore,
    /// Locks the pixels against tracking, prompts and brushes.
    Lock,
    /// Removes the lock.
    Unlock,
    /// Keeps the labels, but does not draw, vote or export them.
    Hide,
    /// Shows hidden labels again.
    Show,
    /// Transfers pixels and clicks to another label.
    Merge {
        /// Label that receives them.
        into: LabelId,
    },
    /// Gives one piece of the label to another label.
    ///
    /// On the other frames, the piece consists of the pixels nearer to it than to the rest of the
    /// label.
    Split {
        /// Frame on which the piece is selected.
        frame: usize,
        /// A pixel of the piece.
        #[schemars(with = "[f64; 2]")]
        at_px: DVec2,
        /// Label that receives the piece.
        into: LabelId,
    },
    /// Interpolates shapes between the first and the last frame of the range.
    Interpolate,
    /// Copies the labels of another frame; the frames become keyframes.
    Copy {
        /// Frame to copy from.
        frame: usize,
    },
}

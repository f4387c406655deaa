use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Frame;
use crate::cameras::DepthCameraSource;

/// Sources to open, in order, and the selection of their frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct OpenRequest {
    /// Folders, single images and videos, in order.
    pub sources: Vec<FrameFolder>,
    /// World units (metres) per step of an integer depth value; > 0.
    pub depth_unit: f64,
    /// World units (metres) per unit of a float depth value; > 0.
    pub float_depth_unit: f64,
    /// Camera that measured the depth, if it differs from that of the images.
    ///
    /// `None` = depth and image correspond pixel for pixel.
    pub depth_camera: Option<DepthCameraSource>,
    /// Whether depth that is found among the images of a folder is left out.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub ignore_depth: bool,
    /// Takes every `every`-th source frame; ≥ 1.
    pub every: usize,
    /// Index of the first source frame to take, counted from 0 over all sources; `None` = 0.
    pub from: Option<usize>,
    /// Index of the last source frame that may be taken (inclusive); `None` = no limit.
    pub to: Option<usize>,
}

impl Default for OpenRequest {
    fn default() -> Self {
        Self {
            sources: Vec::new(),
            depth_unit: 0.001,
            float_depth_unit: 1.0,
            depth_camera: None,
            ignore_depth: false,
            every: 1,
            from: None,
            to: None,
        }
    }
}

impl OpenRequest {
    /// Returns the unit of floating-point depth for a given unit of integer depth.
    ///
    /// Floating-point depth is in metres unless the unit differs from the default for integers.
    #[must_use]
    pub fn float_unit_for(depth_unit: f64) -> f64 {
        let default = Self::default();
        if depth_unit.to_bits() == default.depth_unit.to_bits() {
            default.float_depth_unit
        } else {
            depth_unit
        }
    }
}

/// One source of frames, with its optional depth images.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct FrameFolder {
    /// A folder (read with its subfolders), a single image, or a video.
    pub frames: PathBuf,
    /// The folder (or single file) of depth images that belong to it, of 16-bit integers or floats.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth: Option<PathBuf>,
}

impl From<PathBuf> for FrameFolder {
    fn from(frames: PathBuf) -> Self {
        Self {
            frames,
            depth: None,
        }
    }
}

/// Frames in project order, with warnings for the user.
#[derive(Debug, Clone, PartialEq)]
pub struct Opened {
    /// Frames with unique names; sizes are as shown.
    pub frames: Vec<Frame>,
    /// Warnings, one line each.
    pub warnings: Vec<String>,
}

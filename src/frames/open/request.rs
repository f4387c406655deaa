use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::Frame;
use crate::cameras::DepthCameraSource;

/// What to open: one source after another, thinned.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct OpenRequest {
    /// Folders, single pictures and films, in order.
    pub sources: Vec<FrameFolder>,
    /// World units (metres) per step of an integer depth value; > 0.
    pub depth_unit: f64,
    /// World units (metres) per unit of a float depth value; > 0.
    pub float_depth_unit: f64,
    /// The camera that measured the depths, where it is not the pictures'; `None` = depth lies on its picture, pixel for
    /// pixel.
    pub depth_camera: Option<DepthCameraSource>,
    /// Takes every so-many-th source frame; ≥ 1.
    pub every: usize,
    /// The first source frame to take, counted from 0 over all sources; `None` = the first of all.
    pub from: Option<usize>,
    /// The last source frame that may be taken, itself included; `None` = the last of all.
    pub to: Option<usize>,
}

impl Default for OpenRequest {
    fn default() -> Self {
        Self {
            sources: Vec::new(),
            depth_unit: 0.001,
            float_depth_unit: 1.0,
            depth_camera: None,
            every: 1,
            from: None,
            to: None,
        }
    }
}

/// One place that frames come from.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FrameFolder {
    /// A folder (read with its subfolders), a single picture, or a film.
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

/// Frames in project order and what the user should know about them.
#[derive(Debug, Clone, PartialEq)]
pub struct Opened {
    /// Names are unique; sizes are as shown.
    pub frames: Vec<Frame>,
    /// One line each.
    pub warnings: Vec<String>,
}

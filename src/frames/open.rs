use std::path::PathBuf;

use serde::{Deserialize, Serialize};

/// One `--frames` with the `--depth` that belongs to it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FrameFolder {
    /// A folder of pictures, one picture, or a film.
    pub frames: PathBuf,
    /// Folder of 16-bit depth pictures.
    #[serde(default)]
    pub depth: Option<PathBuf>,
}

/// What to open.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OpenRequest {
    /// Sources in order.
    pub sources: Vec<FrameFolder>,
    /// World units (metres) per step of a stored depth.
    pub depth_unit: f64,
    /// Take every n-th source frame, from 1.
    pub every: usize,
    /// First source frame taken.
    #[serde(default)]
    pub from: Option<usize>,
    /// Last source frame taken (included).
    #[serde(default)]
    pub to: Option<usize>,
}

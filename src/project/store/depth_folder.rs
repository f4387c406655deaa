//! Depth maps that stereo made.
//!
//! The folder holds `maps/NAME.tiff` per frame and the outcome of each frame in `views.json`.
//! Unfinished work lies below `rounds/`, so that a run that was stopped or killed can be resumed.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};

use super::durable;
use super::versions::{depth_file, depths_path};
use ostra_cloud::SceneError;
use ostra_core::disk;
use ostra_frames::{DepthMap, DepthSource, EstimatedDepth, Frame, FrameError};
use ostra_reconstruct::stereo::{DepthEstimate, DepthStore, Stage, ViewOutcome};

/// Maximum size of the account. One of a million frames takes half of it; a larger one is damaged.
const MAX_ACCOUNT_BYTES: u64 = 512 << 20;

const ACCOUNT: &str = "views.json";
const ROUNDS: &str = "rounds";
const MAPS: &str = "maps";

/// Returns the path of a frame's finished depth map, relative to the project's folder.
#[must_use]
pub fn depth_map_path(version: u64, frame: &str) -> PathBuf {
    depths_path(version).join(MAPS).join(depth_file(frame))
}

/// The folder of one version of the depth maps.
#[derive(Debug, Clone)]
pub struct DepthFolder {
    folder: PathBuf,
    names: Vec<String>,
    scale: f32,
}

/// How the depth maps of a folder were made.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct DepthRunRecord {
    /// Digest of cameras, images and options; equal keys give equal depths.
    pub key: String,
    /// Maximum longer side of the depth maps, in pixels.
    pub max_side: u32,
    /// Outcome of each view, by frame number; `None` while the depths are being computed.
    pub outcomes: Option<BTreeMap<usize, ViewOutcome>>,
}

impl DepthFolder {
    /// Returns the folder of a version.
    #[must_use]
    pub fn new(root: &Path, version: u64, frames: &[Frame]) -> Self {
        let names = frames.iter().map(|frame| depth_file(&frame.name)).collect();
        Self {
            folder: root.join(depths_path(version)),
            names,
            scale: 1.0,
        }
    }

    /// Multiplies depths on reading by the scale that the frames have been given since.
    #[must_use]
    pub fn scaled(self, frames: &[Frame]) -> Self {
        let scale = frames.iter().find_map(|frame| match frame.depth {
            Some(DepthSource::Estimated { scale, .. }) => Some(scale as f32),
            _ => None,
        });
        Self {
            scale: scale.unwrap_or(1.0),
            ..self
        }
    }

    /// Writes the account of how the depth maps were made.
    ///
    /// # Errors
    ///
    /// Returns an error if the file cannot be written.
    pub fn save_account(&self, account: &DepthRunRecord) -> Result<()> {
        durable::replace(
            &self.folder.join(ACCOUNT),
            &serde_json::to_vec_pretty(account)?,
        )
    }

    /// Reads the account of how the depth maps were made.
    ///
    /// # Errors
    ///
    /// Returns an error if the file is missing or damaged.
    pub fn load_account(&self) -> Result<DepthRunRecord> {
        let path = self.folder.join(ACCOUNT);
        let bytes = disk::read_regular_up_to(&path, MAX_ACCOUNT_BYTES)
            .with_context(|| format!("{}: cannot be read; reconstruct again", path.display()))?;
        serde_json::from_slice(&bytes)
            .with_context(|| format!("{}: is damaged; reconstruct again", path.display()))
    }

    /// Returns the folder of the sparse points that were made for these depth maps.
    #[must_use]
    pub fn sparse(&self) -> PathBuf {
        self.folder.join(ROUNDS).join("sparse")
    }

    /// Removes the files that were kept for resuming.
    pub fn finish(&self) {
        let _ = fs::remove_dir_all(self.folder.join(ROUNDS));
    }

    /// Returns whether the finished depth map of a frame exists.
    #[must_use]
    pub fn is_complete(&self, frame: usize) -> bool {
        self.path(frame, Stage::Complete).is_file()
    }

    fn path(&self, frame: usize, stage: Stage) -> PathBuf {
        self.of_stage(stage).join(&self.names[frame])
    }

    fn of_stage(&self, stage: Stage) -> PathBuf {
        match stage {
            Stage::Round(round) => self.folder.join(ROUNDS).join(round.to_string()),
            Stage::Filtered => self.folder.join(ROUNDS).join("filtered"),
            Stage::Complete => self.folder.join(MAPS),
        }
    }
}

impl DepthStore for DepthFolder {
    fn load(&self, frame: usize, stage: Stage) -> Result<Option<Arc<DepthEstimate>>, SceneError> {
        let EstimatedDepth {
            camera,
            depth,
            normals,
            confidence,
        } = match EstimatedDepth::read(&self.path(frame, stage)) {
            Ok(made) => made,
            Err(FrameError::Missing { .. }) => return Ok(None),
            Err(error) => return Err(error.into()),
        };
        let depths = depth
            .depths
            .iter()
            .map(|depth| self.scale * depth)
            .collect();
        Ok(Some(Arc::new(DepthEstimate {
            camera,
            depths,
            normals,
            confidence,
        })))
    }

    fn save(&self, frame: usize, stage: Stage, estimate: DepthEstimate) -> Result<(), SceneError> {
        let path = self.path(frame, stage);
        let DepthEstimate {
            camera,
            depths,
            normals,
            confidence,
        } = estimate;
        let depth = DepthMap {
            width: camera.width,
            height: camera.height,
            depths,
        };
        let encoded = EstimatedDepth {
            camera,
            depth,
            normals,
            confidence,
        }
        .encode();
        let written = encoded
            .map_err(anyhow::Error::from)
            .and_then(|bytes| durable::replace(&path, &bytes));
        written.map_err(|error| SceneError::Request(format!("{error:#}")))
    }

    fn forget(&self, stage: Stage) -> Result<(), SceneError> {
        let folder = self.of_stage(stage);
        match fs::remove_dir_all(&folder) {
            Err(reason) if reason.kind() != std::io::ErrorKind::NotFound => Err(SceneError::Io {
                path: folder,
                reason,
            }),
            _ => Ok(()),
        }
    }
}

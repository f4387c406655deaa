//! Files of a reconstruction.
//!
//! These are the sparse model of the project's cameras and the outcome of each frame.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result};
use glam::DVec3;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::{durable, versions};
use crate::{Project, ResultKind};
use ostra_core::disk;
use ostra_frames::cameras::{
    ModelEncoding, SparsePoints, read_sparse_model, with_text_names, write_colmap_model,
};
use ostra_frames::{Frame, FrameCamera, FrameError};
use ostra_reconstruct::rgbd::FrameLink;
use ostra_reconstruct::sfm::RegistrationStatus;

/// The data from which `sparse/` was written.
#[derive(Debug, Clone)]
pub struct WrittenSparse {
    /// Frames whose cameras it holds.
    pub frames: Arc<Vec<Frame>>,
    /// Version of the points it holds.
    pub version: Option<u64>,
}

/// Writes the sparse model for other tools if it has changed.
///
/// Cameras that such a model cannot represent (of mirrored images) do not prevent saving, because
/// `project.toml` holds them.
///
/// # Errors
///
/// Returns an error if a file cannot be written.
pub(super) fn write(
    root: &Path,
    project: &Project,
    before: Option<&WrittenSparse>,
) -> Result<WrittenSparse> {
    let frames = &project.frames;
    let version = versions::version_in_force(project, ResultKind::Cameras);
    let same = |before: &WrittenSparse| {
        before.version == version
            && (Arc::ptr_eq(&before.frames, frames) || before.frames == *frames)
    };
    let posed = frames.iter().any(|frame| frame.posed_camera().is_some());
    if posed && !before.is_some_and(same) {
        let sparse = project.global_points(load_sparse(root, project));
        let global = project.global_frames();
        let named = with_text_names(&global);
        let named = named.as_deref().unwrap_or(&global);
        let written = write_colmap_model(&root.join("sparse"), named, &sparse, ModelEncoding::Text);
        if let Err(error @ FrameError::Io { .. }) = written {
            return Err(error.into());
        }
    }
    Ok(WrittenSparse {
        frames: Arc::clone(frames),
        version,
    })
}

/// Returns the points that the project's cameras were found with; none if cameras were given.
///
/// # Errors
///
/// Returns an error if their files are missing or damaged.
pub fn read_sparse(root: &Path, project: &Project) -> Result<SparsePoints> {
    let version = versions::version_in_force(project, ResultKind::Cameras);
    let read = version
        .map(|version| read_sparse_model(&versions::sparse_path(root, version), &project.frames));
    let lost = "the points that the cameras were found with cannot be read; reconstruct again";
    Ok(read.transpose().context(lost)?.unwrap_or_default())
}

/// Like [`read_sparse`], but returns no points if their files cannot be used.
pub fn load_sparse(root: &Path, project: &Project) -> SparsePoints {
    read_sparse(root, project).unwrap_or_default()
}

/// Maximum size of the files. One of a million frames takes half of it; a larger one is damaged.
const MAX_BYTES: u64 = 512 << 20;

const OUTCOMES: &str = "outcomes.json";
const LINKS: &str = "links.json";
const CAMERAS: &str = "cameras.json";

/// The cameras of one of several models, as the project takes them when the model is used.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ModelCameras {
    /// Origin of the model's positions; see [`Project::origin`].
    pub origin: DVec3,
    /// Cameras by frame number. Those of other models have at most given intrinsics.
    pub cameras: BTreeMap<usize, FrameCamera>,
}

/// Writes the cameras of one of several models next to its points.
///
/// # Errors
///
/// Returns an error if the file cannot be written.
pub fn save_cameras(folder: &Path, cameras: &ModelCameras) -> Result<()> {
    durable::replace(&folder.join(CAMERAS), &serde_json::to_vec(cameras)?)
}

/// Reads the cameras of one of several models.
///
/// # Errors
///
/// Returns an error if the file is missing or damaged.
pub fn load_cameras(folder: &Path) -> Result<ModelCameras> {
    load(&folder.join(CAMERAS))
}

/// Writes the outcome of each frame next to a sparse model.
///
/// # Errors
///
/// Returns an error if the file cannot be written.
pub fn save_outcomes(folder: &Path, outcomes: &BTreeMap<usize, RegistrationStatus>) -> Result<()> {
    durable::replace(
        &folder.join(OUTCOMES),
        &serde_json::to_vec_pretty(outcomes)?,
    )
}

/// Writes the links between frames next to a sparse model, if there are any.
///
/// # Errors
///
/// Returns an error if the file cannot be written.
pub fn save_links(folder: &Path, links: &[FrameLink]) -> Result<()> {
    if links.is_empty() {
        Ok(())
    } else {
        durable::replace(&folder.join(LINKS), &serde_json::to_vec(links)?)
    }
}

/// Reads the outcome of each frame, by frame number.
///
/// # Errors
///
/// Returns an error if the file is missing or damaged.
pub fn load_outcomes(folder: &Path) -> Result<BTreeMap<usize, RegistrationStatus>> {
    load(&folder.join(OUTCOMES))
}

/// Reads the links between frames; a missing file has none.
///
/// # Errors
///
/// Returns an error if the file is damaged.
pub fn load_links(folder: &Path) -> Result<Vec<FrameLink>> {
    let path = folder.join(LINKS);
    if path.exists() {
        load(&path)
    } else {
        Ok(Vec::new())
    }
}

fn load<T: DeserializeOwned>(path: &Path) -> Result<T> {
    let bytes = disk::read_regular_up_to(path, MAX_BYTES)
        .with_context(|| format!("{}: cannot be read", path.display()))?;
    serde_json::from_slice(&bytes)
        .with_context(|| format!("{}: is damaged; reconstruct again", path.display()))
}

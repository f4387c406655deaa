//! The files of a reconstruction: the sparse model of the project's cameras, and next to it what became of each frame.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result};
use serde::de::DeserializeOwned;

use super::{durable, versions};
use crate::{Project, ResultKind};
use ostra_core::disk;
use ostra_frames::cameras::{
    ModelEncoding, SparsePoints, read_sparse_model, with_text_names, write_colmap_model,
};
use ostra_frames::{Frame, FrameError};
use ostra_reconstruct::rgbd::FrameLink;
use ostra_reconstruct::sfm::Outcome;

/// What `sparse/` was written from.
#[derive(Debug, Clone)]
pub struct WrittenSparse {
    /// The frames whose cameras it holds.
    pub frames: Arc<Vec<Frame>>,
    /// The version of the points it holds.
    pub version: Option<u64>,
}

/// Writes the sparse model for other tools, where it changed since it was written. Cameras that such a model cannot hold
/// (of mirrored images) are no reason not to save: `project.toml` has them.
///
/// # Errors
/// When a file cannot be written.
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

/// The points that the project's cameras were found with; none where cameras were given.
///
/// # Errors
/// When their files are missing or damaged.
pub fn read_sparse(root: &Path, project: &Project) -> Result<SparsePoints> {
    let version = versions::version_in_force(project, ResultKind::Cameras);
    let read = version
        .map(|version| read_sparse_model(&versions::sparse_path(root, version), &project.frames));
    let lost = "the points that the cameras were found with cannot be read; reconstruct again";
    Ok(read.transpose().context(lost)?.unwrap_or_default())
}

/// As [`read_sparse`]; none where their files cannot be used, for work that can do without.
pub fn load_sparse(root: &Path, project: &Project) -> SparsePoints {
    read_sparse(root, project).unwrap_or_default()
}

/// A larger file is damaged: one of a million frames takes half of it.
const MAX_BYTES: u64 = 512 << 20;

const OUTCOMES: &str = "outcomes.json";
const LINKS: &str = "links.json";

/// Writes beside a sparse model what became of each frame when it was made.
///
/// # Errors
/// When the file cannot be written.
pub fn save_outcomes(folder: &Path, outcomes: &BTreeMap<usize, Outcome>) -> Result<()> {
    durable::replace(
        &folder.join(OUTCOMES),
        &serde_json::to_vec_pretty(outcomes)?,
    )
}

/// Writes beside a sparse model what ties its frames together; nothing where there are no links.
///
/// # Errors
/// When the file cannot be written.
pub fn save_links(folder: &Path, links: &[FrameLink]) -> Result<()> {
    if links.is_empty() {
        Ok(())
    } else {
        durable::replace(&folder.join(LINKS), &serde_json::to_vec(links)?)
    }
}

/// What became of each frame, by number.
///
/// # Errors
/// When the file is gone or damaged.
pub fn load_outcomes(folder: &Path) -> Result<BTreeMap<usize, Outcome>> {
    load(&folder.join(OUTCOMES))
}

/// What ties the frames together; nothing where no file tells.
///
/// # Errors
/// When the file is damaged.
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

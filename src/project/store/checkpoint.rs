use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result};

use super::folder::{Written, WrittenSparse};
use super::{history_file, manifest, mask_files, versions};
use crate::{History, Project, ResultKind};
use ostra_core::job::Progress;
use ostra_frames::FrameError;
use ostra_frames::cameras::{
    ModelEncoding, SparsePoints, read_sparse_model, with_text_names, write_colmap_model,
};

/// The history keeps at least this many bytes of steps, and at most twice as many.
pub const HISTORY_BYTES: usize = 16 << 20;

/// All that a checkpoint writes, as it was when the checkpoint was begun.
#[derive(Debug)]
pub struct Checkpoint {
    pub(super) root: PathBuf,
    pub(super) project: Arc<Project>,
    pub(super) history: History,
    /// The journal's records that `history.jsonl` lacks.
    pub(super) lines: Vec<u8>,
    pub(super) seq: u64,
    pub(super) before: Written,
}

impl Checkpoint {
    /// Writes masks, history and last `project.toml`. A kill or a full disk at any moment leaves files that open to
    /// the same project.
    ///
    /// # Errors
    /// When a file cannot be written, or on a stop; the journal still holds everything.
    pub fn write(mut self, progress: &Progress) -> Result<Written> {
        let (root, project) = (&self.root, self.project.as_ref());
        let masks = mask_files::runs(project)?;
        mask_files::write(root, project, &self.before.masks, progress)?;
        mask_files::write_origins(root, project)?;
        let sparse = self.write_sparse()?;
        let length = self.before.history_length;
        let grown = length as usize + self.lines.len();
        let history_length = if grown > 2 * HISTORY_BYTES && self.history.keep(HISTORY_BYTES) {
            history_file::rewrite(root, &self.history, self.seq)?
        } else {
            history_file::append(root, length, &self.lines)?
        };
        manifest::write(root, project, self.seq)?;
        versions::collect(root, project, &self.history);
        mask_files::remove_gone(root, &masks, &self.before.masks);
        Ok(Written {
            seq: self.seq,
            masks,
            sparse,
            history_length,
            history_seq: self.seq,
        })
    }

    /// Writes the sparse model for other tools, where it changed. Cameras that such a model cannot hold (of mirrored
    /// pictures) are no reason not to save: `project.toml` has them.
    fn write_sparse(&self) -> Result<Option<WrittenSparse>> {
        let frames = &self.project.frames;
        let version = versions::version_in_force(&self.project, ResultKind::Cameras);
        let same = |before: &WrittenSparse| {
            before.version == version
                && (Arc::ptr_eq(&before.frames, frames) || before.frames == *frames)
        };
        let posed = frames.iter().any(|frame| frame.posed_camera().is_some());
        if posed && !self.before.sparse.as_ref().is_some_and(same) {
            let sparse = self
                .project
                .global_points(load_sparse(&self.root, &self.project));
            let global = self.project.global_frames();
            let named = with_text_names(&global);
            let named = named.as_deref().unwrap_or(&global);
            let written = write_colmap_model(
                &self.root.join("sparse"),
                named,
                &sparse,
                ModelEncoding::Text,
            );
            if let Err(error @ FrameError::Io { .. }) = written {
                return Err(error.into());
            }
        }
        Ok(Some(WrittenSparse {
            frames: Arc::clone(frames),
            version,
        }))
    }
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

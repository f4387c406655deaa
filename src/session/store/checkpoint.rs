use std::path::PathBuf;
use std::sync::Arc;

use anyhow::Result;

use super::folder::Written;
use super::{history_file, manifest, mask_files, versions};
use crate::engine::job::Progress;
use crate::frames::cameras::write_colmap_model;
use crate::frames::{Frame, FrameError};
use crate::session::{History, Project};

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
        Ok(Written { seq: self.seq, masks, sparse, history_length, history_seq: self.seq })
    }

    /// Writes the cameras for other tools, where they changed. Cameras that such a model cannot hold (of mirrored
    /// pictures) are no reason not to save: `project.toml` has them.
    fn write_sparse(&self) -> Result<Option<Arc<Vec<Frame>>>> {
        let frames = &self.project.frames;
        let known = self.before.sparse.as_ref().is_some_and(|before| Arc::ptr_eq(before, frames) || before == frames);
        let posed = frames.iter().any(|frame| frame.posed_camera().is_some());
        if posed && !known {
            let written = write_colmap_model(&self.root.join("sparse"), frames, &[]);
            if let Err(error @ FrameError::Io { .. }) = written {
                return Err(error.into());
            }
        }
        Ok(Some(Arc::clone(frames)))
    }
}

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::Result;

use super::mask_files::Runs;
use super::sparse_model::{self, WrittenSparse};
use super::{history_file, manifest, mask_files, versions};
use crate::{History, Project};
use ostra_core::job::Progress;

/// Minimum size of the stored history, in bytes; it grows to at most twice as much.
pub const HISTORY_BYTES: usize = 16 << 20;

/// State of the files next to the journal after a checkpoint.
#[derive(Debug, Clone, Default)]
pub struct Written {
    /// Number of the last record that `project.toml` contains.
    pub seq: u64,
    /// The masks.
    pub masks: Runs,
    /// State of `sparse/`; `None` if unknown.
    pub sparse: Option<WrittenSparse>,
    /// Bytes of complete lines in `history.jsonl`.
    pub history_length: u64,
    /// Number of the last record in `history.jsonl`.
    pub history_seq: u64,
}

/// The data that a checkpoint writes, as of the time when it was begun.
#[derive(Debug)]
pub struct Checkpoint {
    pub(super) root: PathBuf,
    pub(super) project: Arc<Project>,
    pub(super) history: History,
    /// Records of the journal that `history.jsonl` lacks.
    pub(super) lines: Vec<u8>,
    pub(super) seq: u64,
    pub(super) before: Written,
}

impl Checkpoint {
    /// Writes the masks, the history and finally `project.toml`.
    ///
    /// After a kill or with a full disk, the files still open to the same project.
    ///
    /// # Errors
    ///
    /// Returns an error if a file cannot be written or the progress is stopped. The journal still
    /// holds everything.
    pub fn write(mut self, progress: &Progress) -> Result<Written> {
        let (root, project) = (&self.root, self.project.as_ref());
        let masks = mask_files::runs(project)?;
        mask_files::write(root, project, &self.before.masks, progress)?;
        mask_files::write_origins(root, project)?;
        let sparse = sparse_model::write(root, project, self.before.sparse.as_ref())?;
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
            sparse: Some(sparse),
            history_length,
            history_seq: self.seq,
        })
    }
}

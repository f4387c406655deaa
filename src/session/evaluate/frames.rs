use std::path::Path;

use anyhow::Result;

use crate::engine::job::Progress;
use crate::frames::{Frame, FrameFolder, OpenRequest, open};
use crate::session::store::Folder;

/// Bytes of decoded pictures kept.
pub(super) const PIXEL_BYTES: usize = 128 << 20;

/// Frames of a folder, a film, or a project, and what the user should know.
pub(super) fn read_frames(path: &Path, progress: &Progress) -> Result<(Vec<Frame>, Vec<String>)> {
    if path.join("project.toml").is_file() {
        let loaded = Folder::view(path, "only its frames are read", progress)?;
        return Ok((loaded.project.frames.to_vec(), loaded.warnings));
    }
    let sources = vec![FrameFolder::from(path.to_owned())];
    let opened = open(&OpenRequest { sources, ..OpenRequest::default() }, progress)?;
    Ok((opened.frames, opened.warnings))
}

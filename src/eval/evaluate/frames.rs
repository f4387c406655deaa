use std::path::Path;

use anyhow::Result;

use crate::mask_score::{MaskScore, ScoreOptions, score_masks};
use ostra_cloud::fuse::naming;
use ostra_core::job::Progress;
use ostra_frames::{Frame, FrameError, FrameFolder, OpenRequest, open};
use ostra_project::store::Folder;

/// Capacity of the cache of decoded images, in bytes.
pub(super) const PIXEL_BYTES: usize = 128 << 20;

/// Reads the frames of a folder, a video, or a project; also returns warnings.
pub(super) fn read_frames(path: &Path, progress: &Progress) -> Result<(Vec<Frame>, Vec<String>)> {
    if path.join("project.toml").is_file() {
        let loaded = Folder::view(path, "only its frames are read", progress)?;
        return Ok((loaded.project.frames.to_vec(), loaded.warnings));
    }
    let sources = vec![FrameFolder::from(path.to_owned())];
    let opened = open(
        &OpenRequest {
            sources,
            ..OpenRequest::default()
        },
        progress,
    )?;
    Ok((opened.frames, opened.warnings))
}

/// Returns the frames that `read` accepts, and a warning with the names of the others.
///
/// # Errors
/// Returns the first error of `read` if it accepts no frame, or an error if stopped.
pub(super) fn readable_frames(
    frames: Vec<Frame>,
    read: impl Fn(&Frame) -> Result<(), FrameError>,
    progress: &Progress,
) -> Result<(Vec<Frame>, Option<String>)> {
    let count = frames.len();
    let (mut kept, mut unreadable, mut first_error) = (Vec::with_capacity(count), Vec::new(), None);
    progress.stage("read frames")?;
    for (done, frame) in frames.into_iter().enumerate() {
        progress.step(done, count)?;
        match read(&frame) {
            Ok(()) => kept.push(frame),
            Err(FrameError::Stopped(stopped)) => return Err(stopped.into()),
            Err(error) => {
                unreadable.push(frame.name);
                first_error.get_or_insert(error);
            }
        }
    }
    if let Some(error) = first_error.filter(|_| kept.is_empty()) {
        return Err(error.into());
    }
    let names: Vec<&str> = unreadable.iter().map(String::as_str).collect();
    Ok((
        kept,
        naming(
            [
                "cannot be read (image or depth) and is left out; check its files",
                "cannot be read (image or depth) and are left out; check their files",
            ],
            &names,
        ),
    ))
}

/// Scores a folder of mask files against a folder of ground truth masks.
///
/// # Errors
/// Returns the errors of [`score_masks`].
pub fn evaluate_masks(truth: &Path, result: &Path, options: &ScoreOptions) -> Result<MaskScore> {
    Ok(score_masks(truth, result, options, &Progress::default())?)
}

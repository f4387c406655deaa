use std::path::Path;

use anyhow::{Result, ensure};
use glam::DVec3;

use super::frames::{PIXEL_BYTES, read_frames};
use crate::engine::job::Progress;
use crate::frames::cameras::GivenCameras;
use crate::frames::{Frame, FrameStore};
use crate::scene::score::FeatureViews;
use crate::scene::sfm::Sift;
use crate::scene::sfm::matching::NearestMatcher;
use crate::scene::stereo::{SparseOptions, sparse_from_cameras};
use crate::session::origin::make_relative;

/// Relative to `origin`, pictures (a folder, a film, or a project) with their cameras, matched by name, and what they have in common;
/// pictures without a camera are left out. Gives with it what the user should know.
///
/// # Errors
/// When a picture or the cameras cannot be read, or no picture has a camera.
pub(super) fn feature_views(
    pictures: &Path,
    cameras: &Path,
    origin: DVec3,
    progress: &Progress,
) -> Result<(FeatureViews, Vec<String>)> {
    let (mut frames, mut warnings) = read_frames(pictures, progress)?;
    // A project's own poses are in its own space.
    frames.iter_mut().flat_map(|frame| &mut frame.camera).for_each(|camera| camera.camera_from_world = None);
    warnings.extend(GivenCameras::read(cameras)?.match_to(&mut frames)?);
    make_relative(&mut frames, origin);
    let posed = |frame: &Frame| frame.camera.filter(|camera| camera.camera_from_world.is_some());
    frames.retain(|frame| posed(frame).is_some());
    ensure!(!frames.is_empty(), "{}: no picture has a camera in {}", pictures.display(), cameras.display());
    let store = FrameStore::new(PIXEL_BYTES);
    // Features are made of what can be read; here nothing may be missing without a word.
    for frame in &frames {
        progress.check()?;
        store.image(frame)?;
    }
    let views: Vec<usize> = (0..frames.len()).collect();
    let engines = (&Sift::default() as _, &NearestMatcher::for_bytes() as _);
    let features = sparse_from_cameras(&frames, &views, &store, engines, &SparseOptions::default(), progress)?;
    Ok((FeatureViews { cameras: frames.iter().filter_map(posed).collect(), features }, warnings))
}

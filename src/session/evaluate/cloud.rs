use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::read_frames;
use crate::engine::job::Progress;
use crate::frames::cameras::{GivenCameras, SparsePoints};
use crate::frames::{Frame, FrameCamera, FrameStore};
use crate::scene::ply::{PlyCloud, read_ply};
use crate::scene::score::{CloudScore, CloudScoreOptions, score_cloud};
use crate::scene::sfm::Sift;
use crate::scene::sfm::matching::NearestMatcher;
use crate::scene::stereo::{SparseOptions, sparse_from_cameras};

/// Bytes of decoded pictures kept.
const PIXEL_BYTES: usize = 128 << 20;

/// How two cloud files are compared.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CloudEvaluation {
    /// Distances in cloud units; the first decides which points match for the labels.
    pub within: Vec<f64>,
    /// Read deeper labels as their ancestor there (1 = top).
    pub level: Option<usize>,
    /// What has seen the truth.
    pub views: Option<TruthViews>,
}

/// Cameras of a true cloud.
#[derive(Debug, Clone, PartialEq)]
pub struct TruthViews {
    /// Their file, in the truth's space.
    pub cameras: PathBuf,
    /// The number of frusta a truth point must lie in to count.
    pub min_views: usize,
    /// Their pictures, without which a camera is left out: a folder, a film, or a project. What these have in common tells which truth points a camera sees,
    /// for the comparison in depth.
    pub frames: Option<PathBuf>,
}

/// Scores any labelled PLY against any other. Answers with warnings about what the files lack.
///
/// # Errors
/// When a file cannot be read, no picture has a camera or nothing can be compared.
pub fn evaluate_cloud(truth: &Path, result: &Path, evaluation: &CloudEvaluation) -> Result<(CloudScore, Vec<String>)> {
    let progress = Progress::default();
    let (truth, result) = (read(truth, &progress)?, read(result, &progress)?);
    let mut options = CloudScoreOptions {
        within: evaluation.within.clone(),
        level: evaluation.level,
        ..CloudScoreOptions::default()
    };
    let mut warnings = [truth.warnings, result.warnings].concat();
    if let Some(views) = &evaluation.views {
        options.min_views = views.min_views;
        match &views.frames {
            Some(frames) => {
                let seen = SeenFrames::read(frames, &views.cameras, &progress)?;
                (options.cameras, options.features) = (seen.cameras, Some(seen.features));
                warnings.extend(seen.warnings);
            }
            None => options.cameras = frusta(&views.cameras)?,
        }
    }
    let score = score_cloud(&truth.cloud, &result.cloud, &options, &progress)?;
    Ok((score, warnings))
}

fn read(path: &Path, progress: &Progress) -> Result<PlyCloud> {
    Ok(read_ply(path, progress)?)
}

/// Cameras with pictures, and what these have in common.
struct SeenFrames {
    cameras: Vec<FrameCamera>,
    features: SparsePoints,
    warnings: Vec<String>,
}

impl SeenFrames {
    fn read(frames: &Path, cameras: &Path, progress: &Progress) -> Result<Self> {
        let (mut frames, mut warnings) = read_frames(frames, progress)?;
        // A project's own poses are in its own space.
        frames.iter_mut().flat_map(|frame| &mut frame.camera).for_each(|camera| camera.camera_from_world = None);
        warnings.extend(GivenCameras::read(cameras)?.match_to(&mut frames)?);
        let posed = |frame: &Frame| frame.camera.filter(|camera| camera.camera_from_world.is_some());
        frames.retain(|frame| posed(frame).is_some());
        let views: Vec<usize> = (0..frames.len()).collect();
        let store = FrameStore::new(PIXEL_BYTES);
        let engines = (&Sift::default() as _, &NearestMatcher::for_bytes() as _);
        let features = sparse_from_cameras(&frames, &views, &store, engines, &SparseOptions::default(), progress)?;
        Ok(Self { cameras: frames.iter().filter_map(posed).collect(), features, warnings })
    }
}

fn frusta(path: &Path) -> Result<Vec<FrameCamera>> {
    let given = GivenCameras::read(path)?;
    let cameras = given.cameras.iter().map(|camera| {
        let sized = camera.intrinsics.as_ref().and_then(|intrinsics| Some((intrinsics, intrinsics.size?)));
        let (intrinsics, [width, height]) = sized.with_context(|| {
            format!(
                "{}: holds no intrinsics with a picture size; give a COLMAP model or transforms.json",
                path.display()
            )
        })?;
        let intrinsics = intrinsics.for_picture(width, height).map_err(anyhow::Error::msg)?;
        Ok(FrameCamera::given(intrinsics, Some(camera.camera_from_world)))
    });
    cameras.collect()
}

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use crate::engine::job::Progress;
use crate::frames::FrameCamera;
use crate::frames::cameras::GivenCameras;
use crate::scene::ply::{PlyCloud, read_ply};
use crate::scene::score::{CloudScore, CloudScoreOptions, score_cloud};

/// How two cloud files are compared.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CloudEvaluation {
    /// Distances in cloud units; the first decides which points match for the labels.
    pub within: Vec<f64>,
    /// Read deeper labels as their ancestor there (1 = top).
    pub level: Option<usize>,
    /// Cameras in the truth's space, with the number of frusta a truth point must lie in to count.
    pub cameras: Option<(PathBuf, usize)>,
}

/// Scores any labelled PLY against any other. Answers with warnings about what the files lack.
///
/// # Errors
/// When a file cannot be read or nothing can be compared.
pub fn evaluate_cloud(truth: &Path, result: &Path, evaluation: &CloudEvaluation) -> Result<(CloudScore, Vec<String>)> {
    let progress = Progress::default();
    let (truth, result) = (read(truth, &progress)?, read(result, &progress)?);
    let (cameras, min_views) = match &evaluation.cameras {
        Some((path, min_views)) => (frusta(path)?, *min_views),
        None => (Vec::new(), 0),
    };
    let options = CloudScoreOptions {
        within: evaluation.within.clone(),
        level: evaluation.level,
        cameras,
        min_views,
        truth_from_result: None,
    };
    let score = score_cloud(&truth.cloud, &result.cloud, &options, &progress)?;
    Ok((score, [truth.warnings, result.warnings].concat()))
}

fn read(path: &Path, progress: &Progress) -> Result<PlyCloud> {
    Ok(read_ply(path, progress)?)
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

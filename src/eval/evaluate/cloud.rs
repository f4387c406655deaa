use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use glam::DVec3;

use super::seen::feature_views;
use crate::cloud_score::{CloudScore, CloudScoreOptions, score_cloud};
use ostra_cloud::ply::{PlyCloud, read_ply};
use ostra_core::job::Progress;
use ostra_frames::FrameCamera;
use ostra_frames::cameras::GivenCameras;

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
    /// Their pictures: a folder, a film, or a project. What these have in common tells which truth points a camera
    /// sees, for the comparison in depth; cameras without a picture take no part in that.
    pub frames: Option<PathBuf>,
}

/// Scores any labelled PLY against any other. Answers with warnings about what the files lack.
///
/// # Errors
/// When a file or no picture can be read, no picture has a camera, or nothing can be compared.
pub fn evaluate_cloud(
    truth: &Path,
    result: &Path,
    evaluation: &CloudEvaluation,
) -> Result<(CloudScore, Vec<String>)> {
    let progress = Progress::default();
    let (mut truth, mut result) = (read(truth, &progress)?, read(result, &progress)?);
    let origin = if truth.cloud.origin == DVec3::ZERO {
        result.cloud.origin
    } else {
        truth.cloud.origin
    };
    truth.cloud.move_origin(origin);
    result.cloud.move_origin(origin);
    let mut options = CloudScoreOptions {
        within: evaluation.within.clone(),
        level: evaluation.level,
        ..CloudScoreOptions::default()
    };
    let mut warnings = [truth.warnings, result.warnings].concat();
    if let Some(views) = &evaluation.views {
        options.min_views = views.min_views;
        options.cameras = frusta(&views.cameras, origin)?;
        if let Some(frames) = &views.frames {
            let (pictures, more) = feature_views(frames, &views.cameras, origin, &progress)?;
            options.pictures = Some(pictures);
            warnings.extend(more);
        }
    }
    let score = score_cloud(&truth.cloud, &result.cloud, &options, &progress)?;
    Ok((score, warnings))
}

fn read(path: &Path, progress: &Progress) -> Result<PlyCloud> {
    Ok(read_ply(path, progress)?)
}

fn frusta(path: &Path, origin: DVec3) -> Result<Vec<FrameCamera>> {
    let given = GivenCameras::read(path)?;
    let posed = given
        .cameras
        .iter()
        .filter(|camera| camera.camera_from_world.is_ok());
    let cameras = posed.map(|camera| {
        let sized = camera.intrinsics.as_ref().and_then(|intrinsics| Some((intrinsics, intrinsics.size?)));
        let (intrinsics, [width, height]) = sized.with_context(|| {
            format!(
                "{}: holds no intrinsics with a picture size; give a COLMAP model or transforms.json",
                path.display()
            )
        })?;
        let intrinsics = intrinsics.for_picture(width, height).map_err(anyhow::Error::msg)?;
        let pose = camera.camera_from_world.as_ref().ok().map(|pose| pose.relative_to(origin));
        Ok(FrameCamera::given(intrinsics, pose))
    });
    cameras.collect()
}

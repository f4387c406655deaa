use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use glam::DVec3;

use super::frames::{PIXEL_BYTES, read_frames, readable_frames};
use crate::cloud_score::{CloudScore, CloudScoreOptions, FeatureViews, score_cloud};
use ostra_cloud::ply::{PlyCloud, read_ply};
use ostra_core::job::Progress;
use ostra_frames::cameras::GivenCameras;
use ostra_frames::{Frame, FrameCamera, FrameStore};
use ostra_project::make_relative;
use ostra_reconstruct::sfm::Sift;
use ostra_reconstruct::sfm::matching::NearestMatcher;
use ostra_reconstruct::stereo::{SparseOptions, SparseRequest, sparse_from_cameras};

/// Options for the comparison of two cloud files.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CloudEvaluation {
    /// Match distances in cloud units; the first one is used for the comparison of labels.
    pub within: Vec<f64>,
    /// Depth in the label tree (1 = top); deeper labels are replaced by their ancestor there.
    pub level: Option<usize>,
    /// Cameras that have seen the ground truth.
    pub views: Option<TruthViews>,
}

/// Cameras of a ground truth cloud.
#[derive(Debug, Clone, PartialEq)]
pub struct TruthViews {
    /// Camera file, in the coordinates of the ground truth.
    pub cameras: PathBuf,
    /// Number of frustums that must contain a ground truth point for it to count.
    pub min_views: usize,
    /// Images of the cameras: a folder, a video, or a project.
    ///
    /// Features that they share show which points a camera sees, for the comparison in depth.
    /// Cameras without an image are left out of it.
    pub frames: Option<PathBuf>,
}

/// Scores a labelled PLY file against another one; also returns warnings about the files.
///
/// # Errors
/// Returns an error if a file cannot be read, if no image can be read or has a camera, or if
/// nothing can be compared.
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
            let (image_folder, more) = feature_views(frames, &views.cameras, origin, &progress)?;
            options.images = Some(image_folder);
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
                "{}: holds no intrinsics with an image size; give a COLMAP model or transforms.json",
                path.display()
            )
        })?;
        let intrinsics = intrinsics.for_image(width, height).map_err(anyhow::Error::msg)?;
        let pose = camera.camera_from_world.as_ref().ok().map(|pose| pose.relative_to(origin));
        Ok(FrameCamera::given(intrinsics, pose))
    });
    cameras.collect()
}

/// Returns cameras and common features of images, relative to `origin`, with warnings.
///
/// `pictures` is a folder, a video, or a project; cameras are matched by name. Images that have no
/// camera or cannot be read are left out.
///
/// # Errors
/// Returns an error if the cameras or all images cannot be read, or if no image has a camera.
fn feature_views(
    image_folder: &Path,
    cameras: &Path,
    origin: DVec3,
    progress: &Progress,
) -> Result<(FeatureViews, Vec<String>)> {
    let (mut frames, mut warnings) = read_frames(image_folder, progress)?;
    // The poses of a project are in the coordinates of the project.
    frames
        .iter_mut()
        .flat_map(|frame| &mut frame.camera)
        .for_each(|camera| camera.camera_from_world = None);
    warnings.extend(GivenCameras::read(cameras)?.match_to(&mut frames)?);
    make_relative(&mut frames, origin);
    let posed = |frame: &Frame| {
        frame
            .camera
            .filter(|camera| camera.camera_from_world.is_some())
    };
    frames.retain(|frame| posed(frame).is_some());
    ensure!(
        !frames.is_empty(),
        "{}: no image has a camera in {}",
        image_folder.display(),
        cameras.display()
    );
    let store = FrameStore::new(PIXEL_BYTES);
    // Feature extraction skips unreadable images silently; here they must be reported.
    let (frames, unreadable) =
        readable_frames(frames, |frame| store.image(frame).map(drop), progress)?;
    warnings.extend(unreadable);
    let views: Vec<usize> = (0..frames.len()).collect();
    let request = SparseRequest {
        frames: &frames,
        views: &views,
        extractor: &Sift::default(),
        matcher: &NearestMatcher::for_bytes(),
    };
    let features = sparse_from_cameras(&request, &store, &SparseOptions::default(), progress)?;
    Ok((
        FeatureViews {
            cameras: frames.iter().filter_map(posed).collect(),
            features,
        },
        warnings,
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unreadable_images_are_left_out_and_reported() {
        let folder = tempfile::tempdir().unwrap();
        let [image_folder, cameras] = ["pictures", "cameras"].map(|name| folder.path().join(name));
        for folder in [&image_folder, &cameras] {
            std::fs::create_dir(folder).unwrap();
        }
        let mut images = String::new();
        for k in 0..3_u32 {
            let color =
                |x: u32, y: u32| image::Rgb([(x * 3) as u8, (y * 4) as u8, (x * y % 251) as u8]);
            image::RgbImage::from_fn(64, 48, color)
                .save(image_folder.join(format!("{k}.png")))
                .unwrap();
            images += &format!(
                "{} 1 0 0 0 {} 0 0 1 {k}.png\n\n",
                k + 1,
                -0.02 * f64::from(k)
            );
        }
        std::fs::write(cameras.join("cameras.txt"), "1 PINHOLE 64 48 60 60 32 24\n").unwrap();
        std::fs::write(cameras.join("images.txt"), images).unwrap();
        std::fs::write(cameras.join("points3D.txt"), "").unwrap();
        std::fs::write(image_folder.join("1.png"), "").unwrap();
        let (views, warnings) =
            feature_views(&image_folder, &cameras, DVec3::ZERO, &Progress::default()).unwrap();
        assert_eq!(views.cameras.len(), 2);
        let is_named =
            |line: &String| line.contains("1 frame cannot be read") && line.contains("1.png");
        assert!(warnings.iter().any(is_named), "{warnings:?}");
    }
}

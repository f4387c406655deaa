use std::sync::atomic::{AtomicUsize, Ordering};

use glam::DVec3;
use rayon::prelude::*;

use super::RgbdError;
use super::rgbd_image::RgbdImage;
use crate::sfm::{FeatureExtractor, Features, RegistrationStatus};
use ostra_core::job::Progress;
use ostra_frames::{DepthMap, Frame, FrameStore};
use ostra_geometry::Camera;

/// Minimum share of known depths of a frame that can be registered.
const LEAST_KNOWN: f64 = 0.02;

/// Number of features kept per frame: recordings have thousands of frames.
const FEATURES: usize = 1000;

/// Data of one frame for registration.
#[derive(Debug, Clone)]
pub struct Scan {
    /// Number of the frame.
    pub frame: usize,
    /// Its camera, in the image's full size.
    pub camera: Camera,
    /// Image and depth, reduced in size.
    pub view: RgbdImage,
    /// Features of the image in full size.
    pub features: Features,
    /// Position of each feature in the camera's axes; `None` if the depth is unknown.
    pub places: Vec<Option<DVec3>>,
}

/// A frame by its number, or why it cannot be used.
pub type Read = (usize, Result<Scan, RegistrationStatus>);

/// Reads frames; for unusable ones it returns the reason.
///
/// # Errors
/// [`RgbdError::Stopped`], or an error if features cannot be extracted.
pub fn scans(
    frames: &[Frame],
    chosen: &[usize],
    store: &FrameStore,
    extractor: &dyn FeatureExtractor,
    progress: &Progress,
) -> Result<Vec<Read>, RgbdError> {
    let done = AtomicUsize::new(0);
    let one = |&number: &usize| {
        progress.step(done.fetch_add(1, Ordering::Relaxed), chosen.len())?;
        Ok((number, scan(number, &frames[number], store, extractor)?))
    };
    chosen.par_iter().map(one).collect()
}

/// Reads one frame, or returns why it cannot be used.
///
/// # Errors
/// If features cannot be extracted.
pub fn scan(
    number: usize,
    frame: &Frame,
    store: &FrameStore,
    extractor: &dyn FeatureExtractor,
) -> Result<Result<Scan, RegistrationStatus>, RgbdError> {
    let Some(camera) = frame.camera.as_ref().map(|camera| camera.intrinsics) else {
        return Ok(Err(RegistrationStatus::NoIntrinsics));
    };
    let (image, depth) = match (store.image(frame), store.depth(frame)) {
        (Ok(image), Ok(Some(depth))) => (image, depth),
        (Ok(_), Ok(None)) => return Ok(Err(RegistrationStatus::NoDepth { known: 0.0 })),
        (Err(error), _) | (_, Err(error)) => {
            return Ok(Err(RegistrationStatus::Unreadable {
                why: error.to_string(),
            }));
        }
    };
    let size = (camera.width, camera.height);
    if (image.width, image.height) != size || (depth.width, depth.height) != size {
        return Ok(Err(RegistrationStatus::Unreadable {
            why: "image, depth and camera differ in size; give all in one".into(),
        }));
    }
    let view = RgbdImage::new(&image, &depth, &camera);
    if view.known() < LEAST_KNOWN {
        return Ok(Err(RegistrationStatus::NoDepth {
            known: view.known(),
        }));
    }
    let features = extractor.extract_from_image(&image, None)?;
    let places: Vec<Option<DVec3>> = features
        .keypoints
        .iter()
        .map(|&at_px| place(&camera, &depth, at_px))
        .collect();
    let kept = kept(&features, &places);
    let places = kept.iter().map(|&at| places[at as usize]).collect();
    Ok(Ok(Scan {
        frame: number,
        camera,
        view,
        features: features.select(&kept),
        places,
    }))
}

/// Returns the features to keep: those of known depth first, coarser before finer.
fn kept(features: &Features, places: &[Option<DVec3>]) -> Vec<u32> {
    let scale = |at: u32| features.scales_px.get(at as usize).copied().unwrap_or(0.0);
    let mut order: Vec<u32> = (0..places.len() as u32).collect();
    order.sort_by(|&a, &b| {
        let unknown = |at: u32| places[at as usize].is_none();
        unknown(a)
            .cmp(&unknown(b))
            .then(scale(b).total_cmp(&scale(a)))
            .then(a.cmp(&b))
    });
    order.truncate(FEATURES);
    order.sort_unstable();
    order
}

fn place(camera: &Camera, depth: &DepthMap, at_px: glam::DVec2) -> Option<DVec3> {
    let (x, y) = (at_px.x.max(0.0) as u32, at_px.y.max(0.0) as u32);
    let depth = depth.at(x.min(depth.width - 1), y.min(depth.height - 1));
    (depth.is_finite() && depth > 0.0)
        .then(|| camera.unproject(at_px).extend(1.0) * f64::from(depth))
}

impl Scan {
    /// Returns the mean of its known depths, in world units.
    #[must_use]
    pub fn typical_depth(&self) -> f64 {
        self.view.mean_depth()
    }
}

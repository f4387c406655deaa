//! Input and result of structure from motion.

use std::collections::BTreeMap;

use super::extract::{AllowedPixels, FrameFeatureExtractor};
use super::{
    CachedExtractor, FeatureCache, FeatureExtractor, FeatureMatcher, ImageFeatures, KeypointId,
    MapProblem, MapperOptions, MetricScale, ModelStart, PairOptions, RegistrationStatus,
    SparseModel,
};
use ostra_frames::cameras::{SparseKeypoint, SparsePoint, SparsePoints};
use ostra_frames::{Frame, FrameCamera, FrameStore};
use ostra_geometry::Pose;

/// Input of structure from motion.
pub struct SfmRequest<'a> {
    /// All frames of the project.
    pub frames: &'a [Frame],
    /// Numbers of the frames that form the map, ascending.
    pub mapped: &'a [usize],
    /// Numbers of the frames that are then located in it, ascending.
    pub located: &'a [usize],
    /// Whether poses that frames already have stay fixed; otherwise all are estimated again.
    pub keep_poses: bool,
    /// Pixels where features may lie.
    pub allowed: AllowedPixels<'a>,
    /// Extracts features.
    pub extractor: &'a dyn FeatureExtractor,
    /// The extractor with its cache, if there is one; verified pairs are kept in it too.
    pub cached: Option<&'a CachedExtractor<'a>>,
    /// Matches features.
    pub matcher: &'a dyn FeatureMatcher,
    /// Selection of the pairs to match, by position among the mapped frames.
    pub pairs: PairOptions,
    /// Options of the mapper.
    pub mapper: MapperOptions,
}

impl<'a> SfmRequest<'a> {
    /// Returns the extractor of the features of frames, whose images `store` reads.
    pub(super) fn frame_extractor(&self, store: &'a FrameStore) -> FrameFeatureExtractor<'a> {
        FrameFeatureExtractor {
            frames: self.frames,
            store,
            extractor: self.extractor,
            cached: self.cached,
            allowed: self.allowed,
        }
    }

    /// Returns the cache of verified pairs.
    pub(super) fn cache(&self) -> Option<&'a FeatureCache> {
        self.cached.map(|cached| cached.cache)
    }
}

/// Result of structure from motion.
#[derive(Debug, Clone)]
pub struct SfmResult {
    /// Cameras by frame number.
    pub cameras: BTreeMap<usize, FrameCamera>,
    /// Points and the keypoints that see them; frame numbers as in `cameras`.
    pub sparse: SparsePoints,
    /// Outcomes by frame number.
    pub outcomes: BTreeMap<usize, RegistrationStatus>,
    /// How the model was started.
    pub start: ModelStart,
    /// The models of at least three images that nothing connects with this one, the largest first.
    pub others: Vec<SfmModel>,
    /// The scale from depth maps, if the model was scaled by it.
    pub scale: Option<MetricScale>,
    /// Share by which the matches contradict the cameras; see [`CONTRADICTORY`](super::CONTRADICTORY).
    pub contradiction: f64,
    /// Messages that the user should know about.
    pub warnings: Vec<String>,
    /// Names of the extractor and the matcher.
    pub methods: [&'static str; 2],
    /// Whether the run was stopped, so that the result is incomplete.
    pub stopped: bool,
}

/// One of the models that the images fall into, in coordinates of its own.
#[derive(Debug, Clone)]
pub struct SfmModel {
    /// Cameras by frame number.
    pub cameras: BTreeMap<usize, FrameCamera>,
    /// Points and the keypoints that see them; frame numbers as in `cameras`.
    pub sparse: SparsePoints,
    /// Outcomes by frame number, as they are while the cameras of this model are used.
    pub outcomes: BTreeMap<usize, RegistrationStatus>,
    /// The scale from depth maps, if the model was scaled by it.
    pub scale: Option<MetricScale>,
    /// Messages that the user should know about.
    pub warnings: Vec<String>,
}

impl SfmModel {
    /// Scales the model by a factor.
    pub fn scale_by(&mut self, factor: f64) {
        for pose in self
            .cameras
            .values_mut()
            .filter_map(|camera| camera.camera_from_world.as_mut())
        {
            pose.translation *= factor;
        }
        for point in &mut self.sparse.points {
            point.position *= factor;
        }
    }
}

/// Returns the model's cameras by frame number; `chosen` holds the frame of each image.
#[must_use]
pub fn frame_cameras(
    problem: &MapProblem,
    model: &SparseModel,
    chosen: &[usize],
) -> BTreeMap<usize, FrameCamera> {
    let camera = |(image, &frame): (usize, &usize)| {
        let camera_from_world: Pose = model.poses[image]?;
        let number = problem.images[image].camera;
        let estimated = problem.cameras[number].source != super::IntrinsicsPrior::Given;
        let intrinsics = model.cameras[number];
        Some((
            frame,
            FrameCamera {
                intrinsics,
                camera_from_world: Some(camera_from_world),
                estimated,
            },
        ))
    };
    chosen.iter().enumerate().filter_map(camera).collect()
}

/// Returns the model's points with their colours and errors, and the keypoints that see them.
#[must_use]
pub fn sparse_points(
    problem: &MapProblem,
    model: &SparseModel,
    images: &[ImageFeatures],
    chosen: &[usize],
) -> SparsePoints {
    let mut sparse = SparsePoints::default();
    for (_, point) in model.points() {
        let number = sparse.points.len() as u32;
        let errors: f64 = point
            .track
            .iter()
            .map(|&keypoint| error_px(problem, model, keypoint, point.position))
            .sum();
        let mut color = [0u32; 3];
        for keypoint in &point.track {
            let seen = images[keypoint.image as usize].colors[keypoint.index as usize];
            color = std::array::from_fn(|i| color[i] + u32::from(seen[i]));
            let at_px = problem.images[keypoint.image as usize].keypoints[keypoint.index as usize];
            let keypoints = sparse
                .keypoints
                .entry(chosen[keypoint.image as usize])
                .or_default();
            keypoints.push(SparseKeypoint {
                at_px,
                point: Some(number),
            });
        }
        let observations = point.track.len();
        sparse.points.push(SparsePoint {
            position: point.position,
            color: color.map(|sum| (sum / observations as u32) as u8),
            error_px: Some(errors / observations as f64),
        });
    }
    sparse
}

/// Returns the reprojection error of an observation in pixels; infinite if the image does not see it.
#[must_use]
pub fn error_px(
    problem: &MapProblem,
    model: &SparseModel,
    keypoint: KeypointId,
    position: glam::DVec3,
) -> f64 {
    let image = &problem.images[keypoint.image as usize];
    let Some(pose) = model.poses[keypoint.image as usize] else {
        return f64::INFINITY;
    };
    let seen = model.cameras[image.camera].project(pose.transform(position));
    seen.map_or(f64::INFINITY, |at| {
        at.distance(image.keypoints[keypoint.index as usize])
    })
}

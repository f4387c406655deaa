//! What structure from motion is given, and what it gives.

use std::collections::BTreeMap;

use super::extract::AllowedPixels;
use super::{
    FeatureExtractor, FeatureMatcher, KeypointId, MapProblem, MapperOptions, MetricScale, Outcome,
    PairOptions, PictureFeatures, SparseModel, Start,
};
use ostra_frames::cameras::{SparseKeypoint, SparsePoint, SparsePoints};
use ostra_frames::{Frame, FrameCamera};
use ostra_geometry::Pose;

/// What structure from motion is to do.
pub struct SfmRequest<'a> {
    /// All frames of the project.
    pub frames: &'a [Frame],
    /// Numbers of those that make the map, ascending.
    pub mapped: &'a [usize],
    /// Numbers of those that are then placed in it, ascending.
    pub located: &'a [usize],
    /// Whether poses that frames have stay as they are; else all are found anew.
    pub keep_poses: bool,
    /// Where features may lie.
    pub allowed: AllowedPixels<'a>,
    /// Finds features.
    pub extractor: &'a dyn FeatureExtractor,
    /// Matches them.
    pub matcher: &'a dyn FeatureMatcher,
    /// Which pairs are matched, by place among the mapped frames.
    pub pairs: PairOptions,
    /// How the map is grown.
    pub mapper: MapperOptions,
}

/// What structure from motion made of some frames.
#[derive(Debug, Clone)]
pub struct SfmResult {
    /// By frame number, its camera.
    pub cameras: BTreeMap<usize, FrameCamera>,
    /// Points and the keypoints that see them; frame numbers as in `cameras`.
    pub sparse: SparsePoints,
    /// By frame number, what became of it.
    pub outcomes: BTreeMap<usize, Outcome>,
    /// How the model was begun.
    pub start: Start,
    /// Frames per model, that of the one kept first.
    pub models: Vec<usize>,
    /// The scale that depth pictures gave, where the model was scaled by it.
    pub scale: Option<MetricScale>,
    /// What the user should know.
    pub warnings: Vec<String>,
    /// Names of the extractor and the matcher.
    pub methods: [&'static str; 2],
    /// Whether it was stopped and is a part of what it could be.
    pub stopped: bool,
}

impl SfmResult {
    /// Makes the model larger by a factor.
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

/// The model's cameras by frame number; `chosen` tells the frame of each image.
#[must_use]
pub fn frame_cameras(
    problem: &MapProblem,
    model: &SparseModel,
    chosen: &[usize],
) -> BTreeMap<usize, FrameCamera> {
    let camera = |(image, &frame): (usize, &usize)| {
        let camera_from_world: Pose = model.poses[image]?;
        let number = problem.images[image].camera;
        let estimated = problem.cameras[number].source != super::IntrinsicsSource::Given;
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

/// The model's points with their colours and errors, and the keypoints that see one.
#[must_use]
pub fn sparse_points(
    problem: &MapProblem,
    model: &SparseModel,
    pictures: &[PictureFeatures],
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
            let seen = pictures[keypoint.image as usize].colors[keypoint.index as usize];
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
        let sightings = point.track.len();
        sparse.points.push(SparsePoint {
            position: point.position,
            color: color.map(|sum| (sum / sightings as u32) as u8),
            error_px: Some(errors / sightings as f64),
        });
    }
    sparse
}

/// Reprojection error of a sighting in pixels; infinite where it is not seen.
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

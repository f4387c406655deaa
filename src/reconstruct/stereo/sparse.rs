//! Sparse points of frames with known cameras.

use std::collections::BTreeMap;

use glam::{DMat3, DVec2, DVec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::error::StereoError;
use super::raster::{raster_camera, raster_image, tones};
use super::sparse_pairs::pairs_to_compare;
use crate::sfm::{FeatureExtractor, FeatureMatcher, Features};
use ostra_core::job::{PlannedStage, Progress};
use ostra_core::union_find::DisjointSets;
use ostra_frames::cameras::{SparseKeypoint, SparsePoint, SparsePoints};
use ostra_frames::{Frame, FrameStore};
use ostra_geometry::{
    Camera, Pose, RayObservation, TriangulationOptions, essential_from_pose, fundamental_in_pixels,
    triangulate_robust,
};

/// Options of sparse points for cameras that come without any.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SparseOptions {
    /// Longer side of the images in which features are extracted, 64–8192 pixels.
    pub max_side: u32,
    /// Maximum distance of a match from its epipolar line, and of a point from its observations, in
    /// pixels of those images, above 0.
    pub max_error_px: f64,
    /// Minimum angle between two rays to a point, 0–90 degrees.
    pub min_angle_deg: f64,
}

impl Default for SparseOptions {
    fn default() -> Self {
        Self {
            max_side: 800,
            max_error_px: 2.0,
            min_angle_deg: 2.0,
        }
    }
}

/// Number of pairs matched in parallel before their results are joined.
const TOGETHER: usize = 64;

/// A view's features and camera.
struct FeatureView {
    frame: usize,
    camera: Camera,
    pose: Pose,
    features: Features,
    colors: Vec<[u8; 3]>,
    /// Pixels of the frame per pixel of the features' image.
    scale: DVec2,
}

/// Input of sparse points: frames with known cameras, and what finds their features.
#[derive(Clone, Copy)]
pub struct SparseRequest<'a> {
    /// All frames, by number.
    pub frames: &'a [Frame],
    /// Numbers of the frames that are matched.
    pub views: &'a [usize],
    /// Extracts features.
    pub extractor: &'a dyn FeatureExtractor,
    /// Matches features.
    pub matcher: &'a dyn FeatureMatcher,
}

/// Computes sparse points from features matched between posed views.
///
/// Observations are in pixels of the frames (without distortion if a lens has some). Views that
/// cannot be read are left out.
///
/// # Errors
/// [`StereoError::Sfm`] if features cannot be extracted or matched, [`StereoError::Stopped`].
pub fn sparse_from_cameras(
    request: &SparseRequest<'_>,
    store: &FrameStore,
    options: &SparseOptions,
    progress: &Progress,
) -> Result<SparsePoints, StereoError> {
    let SparseRequest {
        frames,
        views,
        extractor,
        matcher,
    } = *request;
    let count = views.len() as f64;
    progress.plan_next(&[
        PlannedStage::new("features", "Find features", count),
        PlannedStage::new("match", "Match images", count),
        PlannedStage::new("sparse points", "Compute points", 0.1 * count),
    ]);
    progress.stage("features")?;
    let mut found = Vec::new();
    for (done, &number) in views.iter().enumerate() {
        progress.step(done, views.len())?;
        found.extend(view(&frames[number], number, store, extractor, options)?);
    }
    let tracks = matched_tracks(&found, matcher, options, progress)?;
    progress.stage("sparse points")?;
    let mut sparse = SparsePoints::default();
    for (done, track) in tracks.iter().enumerate() {
        if done % 256 == 0 {
            progress.step(done, tracks.len())?;
        }
        add_point(&mut sparse, &found, track, options);
    }
    Ok(sparse)
}

fn view(
    frame: &Frame,
    number: usize,
    store: &FrameStore,
    extractor: &dyn FeatureExtractor,
    options: &SparseOptions,
) -> Result<Option<FeatureView>, StereoError> {
    let Some((lens, pose)) = frame.posed_camera() else {
        return Ok(None);
    };
    let Ok(image) = raster_image(frame, lens, store, options.max_side) else {
        return Ok(None);
    };
    let camera = raster_camera(lens, options.max_side);
    let values: Vec<f32> = tones(&image)
        .luma
        .iter()
        .map(|value| value / 255.0)
        .collect();
    let features = extractor.extract(&values, image.width as usize, image.height as usize, None)?;
    let color = |at: &DVec2| {
        image.at(
            (at.x as u32).min(image.width - 1),
            (at.y as u32).min(image.height - 1),
        )
    };
    let colors = features.keypoints.iter().map(color).collect();
    let scale = DVec2::new(
        f64::from(frame.width) / f64::from(camera.width),
        f64::from(frame.height) / f64::from(camera.height),
    );
    Ok(Some(FeatureView {
        frame: number,
        camera,
        pose: *pose,
        features,
        colors,
        scale,
    }))
}

/// A keypoint of one of the views.
#[derive(Debug, Clone, Copy)]
struct ViewKeypoint {
    view: usize,
    keypoint: usize,
}

/// Returns tracks of keypoints over all matches that agree with the poses.
fn matched_tracks(
    views: &[FeatureView],
    matcher: &dyn FeatureMatcher,
    options: &SparseOptions,
    progress: &Progress,
) -> Result<Vec<Vec<ViewKeypoint>>, StereoError> {
    progress.stage("match")?;
    let features: Vec<&Features> = views.iter().map(|view| &view.features).collect();
    let pairs = pairs_to_compare(&features);
    let matches = matcher.of_set(&features)?;
    let mut tracks = Tracks::new(features.iter().map(|features| features.keypoints.len()));
    let agreeing = |&(first, second): &(usize, usize)| {
        progress.check()?;
        let lines = epipolar_lines(&views[first], &views[second]);
        let at = |a: u32, b: u32| {
            [
                features[first].keypoints[a as usize],
                features[second].keypoints[b as usize],
            ]
        };
        let mut found = matches(first, second)?;
        found.retain(|&(a, b)| line_distance(lines, at(a, b)) <= options.max_error_px);
        Ok(found)
    };
    for (done, some) in pairs.chunks(TOGETHER).enumerate() {
        progress.step(done * TOGETHER, pairs.len())?;
        let found: Vec<Vec<(u32, u32)>> = some
            .par_iter()
            .map(agreeing)
            .collect::<Result<_, StereoError>>()?;
        for (&(first, second), found) in some.iter().zip(found) {
            for (a, b) in found {
                let of_view = |view: usize, keypoint: u32| ViewKeypoint {
                    view,
                    keypoint: keypoint as usize,
                };
                tracks.join(of_view(first, a), of_view(second, b));
            }
        }
    }
    Ok(tracks.finish())
}

/// Returns the fundamental matrix of two posed views: from positions in the first to lines in the second.
fn epipolar_lines(first: &FeatureView, second: &FeatureView) -> DMat3 {
    let second_from_first = second.pose.compose(&first.pose.inverse());
    fundamental_in_pixels(
        essential_from_pose(&second_from_first),
        [&first.camera, &second.camera],
    )
}

/// Returns the larger distance of two matched positions from each other's epipolar lines, in pixels.
fn line_distance(lines: DMat3, [a, b]: [DVec2; 2]) -> f64 {
    let (a, b) = (a.extend(1.0), b.extend(1.0));
    let (in_second, in_first) = (lines * a, lines.transpose() * b);
    let distance = |line: DVec3, at: DVec3| {
        line.dot(at).abs() / line.truncate().length().max(f64::MIN_POSITIVE)
    };
    distance(in_second, b).max(distance(in_first, a))
}

fn add_point(
    sparse: &mut SparsePoints,
    views: &[FeatureView],
    track: &[ViewKeypoint],
    options: &SparseOptions,
) {
    let observations: Vec<RayObservation<'_>> = track
        .iter()
        .map(|&ViewKeypoint { view, keypoint }| {
            let at_px = views[view].features.keypoints[keypoint];
            let camera = &views[view].camera;
            RayObservation {
                camera,
                camera_from_world: &views[view].pose,
                at_px,
                at_plane: camera.unproject(at_px),
            }
        })
        .collect();
    let rule = TriangulationOptions {
        max_error_px: options.max_error_px,
        min_angle: options.min_angle_deg.to_radians(),
    };
    let Some(made) = triangulate_robust(&observations, &rule) else {
        return;
    };
    let number = sparse.points.len() as u32;
    let color = track
        .first()
        .map_or([0; 3], |seen| views[seen.view].colors[seen.keypoint]);
    for &inlier in &made.inliers {
        let ViewKeypoint { view, keypoint } = track[inlier as usize];
        let at_px = views[view].features.keypoints[keypoint] * views[view].scale;
        let seen = SparseKeypoint {
            at_px,
            point: Some(number),
        };
        sparse
            .keypoints
            .entry(views[view].frame)
            .or_default()
            .push(seen);
    }
    sparse.points.push(SparsePoint {
        position: made.position,
        color,
        error_px: None,
    });
}

/// Keypoints of several views joined by matches (union–find).
#[derive(Debug)]
struct Tracks {
    /// Number of the first keypoint of each view, counted over all, then the total.
    first: Vec<usize>,
    sets: DisjointSets,
}

impl Tracks {
    /// Creates the keypoints of each view, none joined.
    pub fn new(counts: impl Iterator<Item = usize>) -> Self {
        let mut first = vec![0];
        counts.for_each(|count| first.push(first[first.len() - 1] + count));
        let sets = DisjointSets::new(first[first.len() - 1]);
        Self { first, sets }
    }

    /// Joins the tracks of two keypoints.
    pub fn join(&mut self, a: ViewKeypoint, b: ViewKeypoint) {
        let [a, b] = [a, b].map(|seen| (self.first[seen.view] + seen.keypoint) as u32);
        self.sets.unite(a, b);
    }

    /// Returns the tracks of two or more keypoints.
    ///
    /// Keypoints of views that occur twice are left out: one of the two is wrong.
    pub fn finish(mut self) -> Vec<Vec<ViewKeypoint>> {
        let mut members: BTreeMap<u32, Vec<ViewKeypoint>> = BTreeMap::new();
        for view in 0..self.first.len() - 1 {
            for at in self.first[view]..self.first[view + 1] {
                let root = self.sets.root(at as u32);
                members.entry(root).or_default().push(ViewKeypoint {
                    view,
                    keypoint: at - self.first[view],
                });
            }
        }
        let mut tracks: Vec<Vec<ViewKeypoint>> = members
            .into_values()
            .filter(|track| track.len() > 1)
            .collect();
        for track in &mut tracks {
            let all = track.clone();
            track.retain(|seen| all.iter().filter(|other| other.view == seen.view).count() == 1);
        }
        tracks.retain(|track| track.len() > 1);
        tracks
    }
}

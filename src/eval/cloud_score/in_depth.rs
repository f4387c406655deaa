use std::collections::BTreeMap;

use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

use ostra_cloud::SceneError;
use ostra_core::job::{Progress, Stopped};
use ostra_frames::FrameCamera;
use ostra_frames::cameras::SparsePoints;
use ostra_geometry::Camera;

/// Maximum distance of compared points, in pixels of the camera's own image.
///
/// At larger distances, a slanted surface alone causes a depth difference.
const NEAR_PX: f64 = 1.0;
/// Radius in which ground truth points occlude others, in pixels of the reduced image.
const TRUTH_HIDES_PX: usize = 4;
/// Radius in which result points occlude others, in pixels of the reduced image.
const RESULT_HIDES_PX: usize = 1;

/// Returns the depth differences between result and ground truth points, in cloud units.
///
/// There is one for each view that sees both points within a pixel of its image. Occluded result
/// points do not count. A view sees the ground truth points that the features of its image show.
///
/// # Errors
/// Returns [`SceneError::Request`] if no image shows a ground truth point, and
/// [`SceneError::Stopped`] if stopped.
pub(super) fn differences_by_features(
    truth: &[Vec3],
    result: &[Vec3],
    views: &FeatureViews,
    progress: &Progress,
) -> Result<Vec<f32>, SceneError> {
    let seen = views.seen_truth(truth, progress)?;
    if seen.iter().all(Vec::is_empty) {
        return Err(SceneError::Request(format!(
            "none of the {} images shows a point of the ground truth by a feature that three of them share from different \
             sides; check that they belong to the cameras, give more images, or leave them out",
            views.cameras.len()
        )));
    }
    let of_view = |(number, camera): (usize, &FrameCamera)| {
        progress.check()?;
        let seen_truth = PointsByPixel::new(truth, camera)
            .only(|dot| seen[number].binary_search(&dot.index).is_ok());
        Ok(differences(&front(result, camera), &seen_truth))
    };
    let all: Vec<Vec<f32>> = views
        .cameras
        .par_iter()
        .enumerate()
        .map(of_view)
        .collect::<Result<_, Stopped>>()?;
    Ok(all.concat())
}

/// Returns the depth differences for cameras without images, in cloud units.
///
/// It assumes that a camera sees all points that are not occluded. Ground truth points are often
/// too sparse to occlude each other, so result points in front occlude them too. A result point
/// that floats in front of a surface is therefore not detected by that surface.
pub(super) fn differences_by_guess(
    truth: &[Vec3],
    result: &[Vec3],
    cameras: &[FrameCamera],
    progress: &Progress,
) -> Result<Vec<f32>, SceneError> {
    let of_camera = |camera: &FrameCamera| {
        progress.check()?;
        let result = front(result, camera);
        let truth = PointsByPixel::new(truth, camera)
            .front(TRUTH_HIDES_PX)
            .before(&result, RESULT_HIDES_PX);
        Ok(differences(&result, &truth))
    };
    let all: Vec<Vec<f32>> = cameras
        .par_iter()
        .map(of_camera)
        .collect::<Result<_, Stopped>>()?;
    Ok(all.concat())
}

/// Returns the result points that no other result point occludes.
fn front(result: &[Vec3], camera: &FrameCamera) -> PointsByPixel {
    PointsByPixel::new(result, camera).front(RESULT_HIDES_PX)
}

fn differences(result: &PointsByPixel, truth: &PointsByPixel) -> Vec<f32> {
    result
        .dots
        .iter()
        .filter_map(|dot| difference(dot, truth))
        .collect()
}

/// Returns the depth difference to the nearest ground truth point within a pixel.
fn difference(dot: &Dot, truth: &PointsByPixel) -> Option<f32> {
    let aside = |other: &Dot| DVec2::distance(other.at_px, dot.at_px);
    let near = truth
        .around(dot.at_px, 1)
        .filter(|other| aside(other) <= NEAR_PX * truth.own_px);
    let nearest = near.min_by(|a, b| aside(a).total_cmp(&aside(b)))?;
    Some((dot.depth - nearest.depth).abs())
}

/// Cameras of images with their common features, which show the points that each camera sees.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FeatureViews {
    /// Cameras of the images, in the coordinates of the ground truth.
    pub cameras: Vec<FrameCamera>,
    /// Points of the features, with keypoints by the index of the camera in `cameras`.
    pub features: SparsePoints,
}

/// Maximum distance between a feature and a ground truth point, in pixels of the reduced image.
///
/// It must hold in all images that show the feature.
const SAME_PX: f64 = 1.0;
/// Minimum number of images that show a feature.
const LEAST_IMAGES: usize = 3;
/// Minimum angle between viewing directions of a feature, in radians.
///
/// A point that is farther behind by 0.02 of the depth is then about a pixel aside in some images.
const LEAST_ANGLE: f64 = 0.0873;

impl FeatureViews {
    /// Returns the indices of the ground truth points that each camera sees, in ascending order.
    ///
    /// These are the points at a feature that enough images share, in these images. Occluded points
    /// have no such feature. The result is not used.
    pub(super) fn seen_truth(
        &self,
        truth: &[Vec3],
        progress: &Progress,
    ) -> Result<Vec<Vec<u32>>, Stopped> {
        let tracks = self.tracks();
        let mut shown: Vec<Vec<u32>> = vec![Vec::new(); self.cameras.len()];
        for (feature, track) in tracks
            .iter()
            .enumerate()
            .filter(|(feature, track)| self.tells(*feature, track))
        {
            track
                .iter()
                .for_each(|&camera| shown[camera].push(feature as u32));
        }
        let meetings = |(shown, camera): (&Vec<u32>, &FrameCamera)| {
            progress.check()?;
            Ok(self.meetings(truth, shown, camera))
        };
        let by_camera: Vec<Vec<(u32, u32)>> = shown
            .par_iter()
            .zip(&self.cameras)
            .map(meetings)
            .collect::<Result<_, Stopped>>()?;
        let mut images: BTreeMap<(u32, u32), usize> = BTreeMap::new();
        by_camera
            .iter()
            .flatten()
            .for_each(|&pair| *images.entry(pair).or_default() += 1);
        let seen = |pairs: Vec<(u32, u32)>| {
            let same = pairs
                .iter()
                .filter(|pair| images[pair] == tracks[pair.0 as usize].len());
            let mut seen: Vec<u32> = same.map(|&(_, truth)| truth).collect();
            seen.sort_unstable();
            seen.dedup();
            seen
        };
        Ok(by_camera.into_iter().map(seen).collect())
    }

    /// Returns the cameras that show each feature.
    fn tracks(&self) -> Vec<Vec<usize>> {
        let cameras = |track: Vec<(usize, u32)>| {
            let mut cameras: Vec<usize> = track.into_iter().map(|(camera, _)| camera).collect();
            cameras.retain(|&camera| camera < self.cameras.len());
            cameras.dedup();
            cameras
        };
        self.features.tracks().into_iter().map(cameras).collect()
    }

    /// Returns whether enough images show a feature, from sufficiently different directions.
    fn tells(&self, feature: usize, track: &[usize]) -> bool {
        let position = self.features.points[feature].position;
        let poses = track
            .iter()
            .filter_map(|&camera| self.cameras[camera].camera_from_world);
        let rays: Vec<DVec3> = poses
            .map(|pose| (pose.centre() - position).normalize_or_zero())
            .collect();
        let far = |a: &DVec3| rays.iter().any(|b| a.angle_between(*b) >= LEAST_ANGLE);
        rays.len() >= LEAST_IMAGES && rays.iter().any(far)
    }

    /// Returns the distinct pairs of feature and ground truth point that are close in an image.
    fn meetings(&self, truth: &[Vec3], shown: &[u32], camera: &FrameCamera) -> Vec<(u32, u32)> {
        let positions: Vec<Vec3> = shown
            .iter()
            .map(|&feature| self.features.points[feature as usize].position.as_vec3())
            .collect();
        let truth = PointsByPixel::new(truth, camera);
        let near = |feature: Dot| {
            let near = truth
                .around(feature.at_px, 1)
                .filter(move |dot| dot.at_px.distance(feature.at_px) <= SAME_PX);
            near.map(move |dot| (shown[feature.index as usize], dot.index))
        };
        let mut pairs: Vec<(u32, u32)> = PointsByPixel::new(&positions, camera)
            .dots
            .iter()
            .copied()
            .flat_map(near)
            .collect();
        pairs.sort_unstable();
        pairs.dedup();
        pairs
    }
}

/// Maximum length of the longer side of reduced images, in pixels.
///
/// At this size, points are close enough to occlude each other.
const SIDE_PX: f64 = 640.0;
/// Depth difference, as a share of the depth, from which a point occludes another.
const BEHIND: f32 = 0.02;

/// A point projected into a camera.
#[derive(Clone, Copy)]
pub(super) struct Dot {
    pub at_px: DVec2,
    /// Depth along the optical axis, in cloud units.
    pub depth: f32,
    /// Index in the cloud.
    pub index: u32,
}

/// The points inside a camera's image, sorted by pixel.
pub(super) struct PointsByPixel {
    width: usize,
    height: usize,
    /// Index of the first dot of each pixel, then the number of dots.
    starts: Vec<u32>,
    pub dots: Vec<Dot>,
    /// Size of a pixel of the camera's own image in pixels of this one; at most 1.
    pub own_px: f64,
}

impl PointsByPixel {
    /// Projects points; the result is empty without a pose.
    pub fn new(points: &[Vec3], camera: &FrameCamera) -> Self {
        let own_px =
            (SIDE_PX / f64::from(camera.intrinsics.width.max(camera.intrinsics.height))).min(1.0);
        let small = shrunk(&camera.intrinsics, own_px);
        let see = |(index, point): (usize, &Vec3)| {
            let x_in_camera = camera.camera_from_world?.transform(point.as_dvec3());
            let at_px = small
                .project(x_in_camera)
                .filter(|&at_px| small.contains(at_px))?;
            Some(Dot {
                at_px,
                depth: x_in_camera.z as f32,
                index: index as u32,
            })
        };
        let dots = points.iter().enumerate().filter_map(see).collect();
        Self::of(small.width as usize, small.height as usize, own_px, dots)
    }

    fn of(width: usize, height: usize, own_px: f64, mut dots: Vec<Dot>) -> Self {
        let pixel = |dot: &Dot| dot.at_px.y as usize * width + dot.at_px.x as usize;
        dots.sort_by_key(pixel);
        let starts = (0..=width * height)
            .map(|at| dots.partition_point(|dot| pixel(dot) < at) as u32)
            .collect();
        Self {
            width,
            height,
            starts,
            dots,
            own_px,
        }
    }

    /// Returns the dots in the pixels within `reach`.
    pub fn around(&self, at_px: DVec2, reach: usize) -> impl Iterator<Item = &Dot> {
        let (x, y) = (at_px.x as usize, at_px.y as usize);
        let columns = x.saturating_sub(reach)..(x + reach + 1).min(self.width);
        (y.saturating_sub(reach)..(y + reach + 1).min(self.height)).flat_map(move |row| {
            let first = self.starts[row * self.width + columns.start] as usize;
            let last = self.starts[row * self.width + columns.end] as usize;
            &self.dots[first..last]
        })
    }

    /// Removes the dots that other dots of the same image within `reach` pixels occlude.
    pub fn front(&self, reach: usize) -> Self {
        self.before(self, reach)
    }

    /// Removes the dots that dots of another image within `reach` pixels occlude.
    pub fn before(&self, other: &Self, reach: usize) -> Self {
        self.only(|dot| {
            !other
                .around(dot.at_px, reach)
                .any(|nearer| dot.depth > nearer.depth * (1.0 + BEHIND))
        })
    }

    /// Returns the dots for which `holds` is true.
    pub fn only(&self, holds: impl Fn(&Dot) -> bool) -> Self {
        let dots = self.dots.iter().filter(|dot| holds(dot)).copied().collect();
        Self::of(self.width, self.height, self.own_px, dots)
    }
}

fn shrunk(camera: &Camera, ratio: f64) -> Camera {
    let side = |length: u32| ((f64::from(length) * ratio).ceil() as u32).max(1);
    Camera {
        width: side(camera.width),
        height: side(camera.height),
        focal_px: camera.focal_px * ratio,
        principal_px: camera.principal_px * ratio,
        ..*camera
    }
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};

    use super::*;
    use ostra_frames::cameras::{SparseKeypoint, SparsePoint, SparsePoints};
    use ostra_geometry::{Camera, Pose};

    fn camera(size: (u32, u32), focal_px: f64, x: f64) -> FrameCamera {
        let pose = Pose {
            rotation: DQuat::IDENTITY,
            translation: DVec3::new(-x, 0.0, 0.0),
        };
        let (width, height) = size;
        let centre = (0.5 * f64::from(width), 0.5 * f64::from(height));
        FrameCamera::given(
            Camera::pinhole(width, height, [focal_px, focal_px], [centre.0, centre.1]),
            Some(pose),
        )
    }

    fn are(found: &[f32], expected: &[f32]) -> bool {
        found.len() == expected.len()
            && found
                .iter()
                .zip(expected)
                .all(|(a, b)| (a - b).abs() < 1e-4)
    }

    #[test]
    fn occluded_points_do_not_count() {
        let camera = camera((1280, 960), 1000.0, 0.0);
        // Ten pixels of the reduced image apart.
        let row = |depth: f32| {
            (0..20).map(move |i| Vec3::new((0.02 * i as f32 - 0.2) * depth, 0.0, depth))
        };
        let truth: Vec<Vec3> = row(2.0).chain(row(3.0)).collect();
        let mut result: Vec<Vec3> = row(2.01).chain(row(3.5)).collect();
        let differences = |result: &[Vec3]| {
            let mut all =
                differences_by_guess(&truth, result, &[camera], &Progress::default()).unwrap();
            all.sort_by(f32::total_cmp);
            all
        };
        let seen = differences(&result);
        assert_eq!(seen.len(), 20, "what lies behind is hidden");
        assert!(
            seen.iter()
                .all(|difference| (difference - 0.01).abs() < 1e-4),
            "{seen:?}"
        );
        result.push(Vec3::new(0.0, 0.0, 1.97));
        let seen = differences(&result);
        assert!(
            (seen[seen.len() - 1] - 0.03).abs() < 1e-4,
            "it stands a little before one of them: {seen:?}"
        );
        result.push(Vec3::new(0.1, 0.0, 1.0));
        assert_eq!(
            differences(&result).len(),
            seen.len() - 1,
            "one of them is hidden"
        );
    }

    #[test]
    fn pixel_distance_refers_to_the_full_size_image() {
        let compared = |aside_px: f32| {
            let result = [Vec3::new(aside_px * 2.0 / 1000.0, 0.0, 2.0)];
            let camera = camera((1280, 960), 1000.0, 0.0);
            differences_by_guess(
                &[Vec3::new(0.0, 0.0, 2.0)],
                &result,
                &[camera],
                &Progress::default(),
            )
            .unwrap()
            .len()
        };
        assert_eq!(
            (compared(0.9), compared(1.2)),
            (1, 0),
            "1.2 are 0.6 of the reduced image"
        );
    }

    /// Returns three ground truth points and four cameras in a row.
    ///
    /// The first point is occluded by the second one in the first image. Only two images share the
    /// third.
    fn views(step: f64) -> ([Vec3; 3], FeatureViews) {
        let cameras = [0.0, 1.0, 2.0, 3.0]
            .map(|k| camera((640, 480), 500.0, step * k))
            .to_vec();
        let truth = [
            Vec3::new(0.0, 0.0, 2.4),
            Vec3::new(0.0, 0.0, 2.0),
            Vec3::new(0.5, 0.0, 2.0),
        ];
        let point = |x: Vec3| SparsePoint {
            position: x.as_dvec3(),
            color: [0; 3],
            error_px: None,
        };
        let mut features = SparsePoints::without_keypoints(vec![point(truth[1]), point(truth[2])]);
        let keypoint = |point: u32| SparseKeypoint {
            at_px: DVec2::ZERO,
            point: Some(point),
        };
        for camera in 0..3 {
            let shown = if camera == 1 { 0..1 } else { 0..2 };
            features
                .keypoints
                .insert(camera, shown.map(keypoint).collect());
        }
        (truth, FeatureViews { cameras, features })
    }

    #[test]
    fn features_determine_visible_points() {
        let (truth, views) = views(0.1);
        let differences = |result: Vec3| {
            differences_by_features(&truth, &[result], &views, &Progress::default()).unwrap()
        };
        let on_it = differences(Vec3::new(0.0, 0.0, 2.001));
        assert!(
            are(&on_it, &[0.001; 3]),
            "three images show it, the fourth does not: {on_it:?}"
        );
        let before_it = differences(Vec3::new(0.0, 0.0, 1.9));
        assert!(
            are(&before_it, &[0.1]),
            "only in the first image it stands before the point: {before_it:?}"
        );
        assert!(
            differences(Vec3::new(0.5, 0.0, 2.001)).is_empty(),
            "two images may agree by chance"
        );
        let behind =
            differences_by_features(&truth, &[truth[0], truth[1]], &views, &Progress::default())
                .unwrap();
        assert!(
            are(&behind, &[0.0; 3]),
            "what lies behind is not taken for seen: {behind:?}"
        );
    }

    #[test]
    fn images_from_one_direction_are_rejected() {
        let (truth, views) = views(0.01);
        let refused =
            differences_by_features(&truth, &truth, &views, &Progress::default()).unwrap_err();
        assert!(refused.to_string().contains("4 images"), "{refused}");
    }
}

use glam::{DVec2, Vec3};
use rayon::prelude::*;

use super::picture::{Dot, Picture};
use super::sightings::seen_truth;
use crate::engine::job::{Progress, Stopped};
use crate::frames::FrameCamera;
use crate::frames::cameras::SparsePoints;

/// Points this near to a truth point in a camera's own picture, in its pixels, are compared with it: farther aside, a slanted
/// surface alone makes a difference.
const NEAR_PX: f64 = 1.0;
/// So many pixels of the reduced picture aside a point may be hidden by another.
const TRUTH_HIDES_PX: usize = 4;
const RESULT_HIDES_PX: usize = 1;

/// For each result point that a camera sees within a pixel of its picture of a truth point that it sees, how far they are
/// apart in depth (in cloud units). Result points that others hide do not count.
///
/// A camera sees the truth points that its picture's `features` show. Without these it is guessed that it sees what
/// nothing hides. Truth points are often too few to hide each other, so what the result shows in front hides them too: a
/// point that floats before a surface is not found out by that surface.
pub(super) fn depth_differences(
    truth: &[Vec3],
    result: &[Vec3],
    cameras: &[FrameCamera],
    features: Option<&SparsePoints>,
    progress: &Progress,
) -> Result<Vec<f32>, Stopped> {
    let sightings = features.map(|features| seen_truth(truth, cameras, features, progress)).transpose()?;
    let of_camera = |(number, camera): (usize, &FrameCamera)| {
        progress.check()?;
        let seen_result = Picture::new(result, camera).front(RESULT_HIDES_PX);
        let truth = Picture::new(truth, camera);
        let seen_truth = match &sightings {
            Some(seen) => truth.only(|dot| seen[number].binary_search(&dot.index).is_ok()),
            None => truth.front(TRUTH_HIDES_PX).before(&seen_result, RESULT_HIDES_PX),
        };
        Ok(seen_result.dots.iter().filter_map(|dot| difference(dot, &seen_truth)).collect())
    };
    let all: Vec<Vec<f32>> = cameras.par_iter().enumerate().map(of_camera).collect::<Result<_, Stopped>>()?;
    Ok(all.concat())
}

/// How far a point's depth is from that of the nearest truth point within a pixel.
fn difference(dot: &Dot, truth: &Picture) -> Option<f32> {
    let aside = |other: &Dot| DVec2::distance(other.at_px, dot.at_px);
    let near = truth.around(dot.at_px, 1).filter(|other| aside(other) <= NEAR_PX * truth.own_px);
    let nearest = near.min_by(|a, b| aside(a).total_cmp(&aside(b)))?;
    Some((dot.depth - nearest.depth).abs())
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};

    use super::*;
    use crate::frames::cameras::{SparseKeypoint, SparsePoint};
    use crate::geometry::{Camera, Pose};

    #[test]
    fn hidden_points_do_not_count() {
        let intrinsics = Camera::pinhole(1280, 960, 1000.0, 1000.0, 640.0, 480.0);
        let camera = FrameCamera::given(intrinsics, Some(Pose::default()));
        // Ten pixels of the shrunk picture apart.
        let row = |depth: f32| (0..20).map(move |i| Vec3::new((0.02 * i as f32 - 0.2) * depth, 0.0, depth));
        let truth: Vec<Vec3> = row(2.0).chain(row(3.0)).collect();
        let mut result: Vec<Vec3> = row(2.01).chain(row(3.5)).collect();
        let differences = |result: &[Vec3]| {
            let mut all = depth_differences(&truth, result, &[camera], None, &Progress::default()).unwrap();
            all.sort_by(f32::total_cmp);
            all
        };
        let seen = differences(&result);
        assert_eq!(seen.len(), 20, "what lies behind is hidden");
        assert!(seen.iter().all(|difference| (difference - 0.01).abs() < 1e-4), "{seen:?}");
        result.push(Vec3::new(0.0, 0.0, 1.97));
        let seen = differences(&result);
        assert!((seen[seen.len() - 1] - 0.03).abs() < 1e-4, "it stands a little before one of them: {seen:?}");
        result.push(Vec3::new(0.1, 0.0, 1.0));
        assert_eq!(differences(&result).len(), seen.len() - 1, "one of them is hidden");
    }

    #[test]
    fn features_tell_what_is_seen() {
        let camera = |x: f64| {
            let pose = Pose { rotation: DQuat::IDENTITY, translation: DVec3::new(-x, 0.0, 0.0) };
            FrameCamera::given(Camera::pinhole(640, 480, 500.0, 500.0, 320.0, 240.0), Some(pose))
        };
        let cameras = [0.0, 0.1, 0.2, 0.3].map(camera);
        // A near point, one behind it in the first picture, and one far aside that no feature shows.
        let truth = [Vec3::new(0.0, 0.0, 2.0), Vec3::new(0.0, 0.0, 3.0), Vec3::new(0.5, 0.0, 2.0)];
        let feature = |position: Vec3| SparsePoint { position: position.as_dvec3(), color: [0; 3], error_px: None };
        let keypoint = |point: u32| SparseKeypoint { at_px: DVec2::ZERO, point: Some(point) };
        let mut features = SparsePoints::without_keypoints(vec![feature(truth[0]), feature(Vec3::new(0.5, 0.0, 2.2))]);
        for shown in 0..3 {
            features.keypoints.insert(shown, vec![keypoint(0), keypoint(1)]);
        }
        let differences = |features: &SparsePoints, result: &[Vec3]| {
            depth_differences(&truth, result, &cameras, Some(features), &Progress::default()).unwrap()
        };
        let near = |found: &[f32], expected: &[f32]| {
            found.len() == expected.len() && found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-4)
        };
        let on_the_near = [Vec3::new(0.0, 0.0, 2.001)];
        assert!(
            near(&differences(&features, &on_the_near), &[0.001; 3]),
            "three pictures show it, the fourth does not"
        );
        let floating = [Vec3::new(0.0, 0.0, 1.9)];
        assert!(
            near(&differences(&features, &floating), &[0.1]),
            "only in the first picture it stands before the point"
        );
        features.keypoints.remove(&2);
        assert!(differences(&features, &on_the_near).is_empty(), "two pictures may agree by chance");
    }
}

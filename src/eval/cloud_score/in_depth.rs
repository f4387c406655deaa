use glam::{DVec2, Vec3};
use rayon::prelude::*;

use super::picture::{Dot, Picture};
use super::sightings::FeatureViews;
use ostra_cloud::SceneError;
use ostra_core::job::{Progress, Stopped};
use ostra_frames::FrameCamera;

/// Points this near to a truth point in a camera's own picture, in its pixels, are compared with it: farther aside, a
/// slanted surface alone makes a difference.
const NEAR_PX: f64 = 1.0;
/// So many pixels of the reduced picture aside a point may be hidden by another.
const TRUTH_HIDES_PX: usize = 4;
const RESULT_HIDES_PX: usize = 1;

/// For each result point that one of these views sees within a pixel of its picture of a truth point that it sees, how
/// far they are apart in depth (in cloud units). Result points that others hide do not count. A view sees the truth
/// points that its picture's features show.
///
/// # Errors
/// [`SceneError::Request`] where no picture shows a truth point; [`SceneError::Stopped`].
pub(super) fn differences_by_features(
    (truth, result): (&[Vec3], &[Vec3]),
    views: &FeatureViews,
    progress: &Progress,
) -> Result<Vec<f32>, SceneError> {
    let seen = views.seen_truth(truth, progress)?;
    if seen.iter().all(Vec::is_empty) {
        return Err(SceneError::Request(format!(
            "none of the {} pictures shows a truth point by a feature that three of them have in common from different \
             sides; check that they belong to the cameras, give more, or leave them out",
            views.cameras.len()
        )));
    }
    let of_view = |(number, camera): (usize, &FrameCamera)| {
        progress.check()?;
        let seen_truth =
            Picture::new(truth, camera).only(|dot| seen[number].binary_search(&dot.index).is_ok());
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

/// The same where no pictures are known: it is guessed that a camera sees what nothing hides. Truth points are often
/// too few to hide each other, so what the result shows in front hides them too: a point that floats before a surface
/// is not found out by that surface.
pub(super) fn differences_by_guess(
    (truth, result): (&[Vec3], &[Vec3]),
    cameras: &[FrameCamera],
    progress: &Progress,
) -> Result<Vec<f32>, SceneError> {
    let of_camera = |camera: &FrameCamera| {
        progress.check()?;
        let result = front(result, camera);
        let truth = Picture::new(truth, camera)
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

/// The result's points that no others of it hide.
fn front(result: &[Vec3], camera: &FrameCamera) -> Picture {
    Picture::new(result, camera).front(RESULT_HIDES_PX)
}

fn differences(result: &Picture, truth: &Picture) -> Vec<f32> {
    result
        .dots
        .iter()
        .filter_map(|dot| difference(dot, truth))
        .collect()
}

/// How far a point's depth is from that of the nearest truth point within a pixel.
fn difference(dot: &Dot, truth: &Picture) -> Option<f32> {
    let aside = |other: &Dot| DVec2::distance(other.at_px, dot.at_px);
    let near = truth
        .around(dot.at_px, 1)
        .filter(|other| aside(other) <= NEAR_PX * truth.own_px);
    let nearest = near.min_by(|a, b| aside(a).total_cmp(&aside(b)))?;
    Some((dot.depth - nearest.depth).abs())
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
            Camera::pinhole(width, height, focal_px, focal_px, centre.0, centre.1),
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
    fn hidden_points_do_not_count() {
        let camera = camera((1280, 960), 1000.0, 0.0);
        // Ten pixels of the reduced picture apart.
        let row = |depth: f32| {
            (0..20).map(move |i| Vec3::new((0.02 * i as f32 - 0.2) * depth, 0.0, depth))
        };
        let truth: Vec<Vec3> = row(2.0).chain(row(3.0)).collect();
        let mut result: Vec<Vec3> = row(2.01).chain(row(3.5)).collect();
        let differences = |result: &[Vec3]| {
            let mut all =
                differences_by_guess((&truth, result), &[camera], &Progress::default()).unwrap();
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
    fn a_pixel_is_one_of_the_cameras_own_picture() {
        let compared = |aside_px: f32| {
            let result = [Vec3::new(aside_px * 2.0 / 1000.0, 0.0, 2.0)];
            let camera = camera((1280, 960), 1000.0, 0.0);
            differences_by_guess(
                (&[Vec3::new(0.0, 0.0, 2.0)], &result),
                &[camera],
                &Progress::default(),
            )
            .unwrap()
            .len()
        };
        assert_eq!(
            (compared(0.9), compared(1.2)),
            (1, 0),
            "1.2 are 0.6 of the reduced picture"
        );
    }

    /// Cameras side by side, and truth points: one hidden by another in the first picture, that other, and one that
    /// only two pictures have in common.
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
    fn features_tell_what_is_seen() {
        let (truth, views) = views(0.1);
        let differences = |result: Vec3| {
            differences_by_features((&truth, &[result]), &views, &Progress::default()).unwrap()
        };
        let on_it = differences(Vec3::new(0.0, 0.0, 2.001));
        assert!(
            are(&on_it, &[0.001; 3]),
            "three pictures show it, the fourth does not: {on_it:?}"
        );
        let before_it = differences(Vec3::new(0.0, 0.0, 1.9));
        assert!(
            are(&before_it, &[0.1]),
            "only in the first picture it stands before the point: {before_it:?}"
        );
        assert!(
            differences(Vec3::new(0.5, 0.0, 2.001)).is_empty(),
            "two pictures may agree by chance"
        );
        let behind = differences_by_features(
            (&truth, &[truth[0], truth[1]]),
            &views,
            &Progress::default(),
        )
        .unwrap();
        assert!(
            are(&behind, &[0.0; 3]),
            "what lies behind is not taken for seen: {behind:?}"
        );
    }

    #[test]
    fn pictures_from_one_side_tell_nothing() {
        let (truth, views) = views(0.01);
        let refused =
            differences_by_features((&truth, &truth), &views, &Progress::default()).unwrap_err();
        assert!(refused.to_string().contains("4 pictures"), "{refused}");
    }
}

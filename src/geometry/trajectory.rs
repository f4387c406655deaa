use glam::{DMat3, DQuat, DVec3};
use serde::Serialize;

use super::pose::nearest_rotation;
use super::{Alignment, GeometryError, Pose, Similarity};

/// Statistics of a list of errors, all ≥ 0; zeros for an empty list.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct ErrorStatistics {
    /// Root mean square.
    pub rmse: f64,
    /// Mean.
    pub mean: f64,
    /// Median; for an even number the mean of the two middle values.
    pub median: f64,
    /// Maximum.
    pub max: f64,
}

impl ErrorStatistics {
    /// Computes the statistics of `errors`, in any order.
    #[must_use]
    pub fn of(errors: &[f64]) -> Self {
        if errors.is_empty() {
            return Self::default();
        }
        let mut sorted = errors.to_vec();
        sorted.sort_by(f64::total_cmp);
        let count = sorted.len();
        Self {
            rmse: (sorted.iter().map(|e| e * e).sum::<f64>() / count as f64).sqrt(),
            mean: sorted.iter().sum::<f64>() / count as f64,
            median: f64::midpoint(sorted[(count - 1) / 2], sorted[count / 2]),
            max: sorted[count - 1],
        }
    }
}

/// Error of a list of cameras relative to the ground truth.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TrajectoryMetrics {
    /// Number of cameras compared.
    pub count: usize,
    /// Alignment applied before the comparison, `truth_world_from_result_world`.
    pub alignment: Similarity,
    /// Distances between camera centres, in units of the ground truth.
    pub centre: ErrorStatistics,
    /// Angles between camera rotations, degrees.
    pub rotation_deg: ErrorStatistics,
    /// Angles between camera rotations that are aligned without the centres, degrees.
    ///
    /// This is usual in rotation averaging (R. Hartley et al., *Rotation Averaging*, IJCV 2013).
    pub own_rotation_deg: ErrorStatistics,
    /// Largest distance of a true centre from their centroid, the scale for centre errors.
    pub extent: f64,
}

impl TrajectoryMetrics {
    /// Compares `result[i]` with `truth[i]` (both `camera_from_world`) after aligning the centres.
    ///
    /// # Errors
    /// Same as [`Similarity::align`] for the camera centres.
    pub fn between(
        result: &[Pose],
        truth: &[Pose],
        alignment: Alignment,
    ) -> Result<Self, GeometryError> {
        Ok(Self::after(
            Similarity::align(&centres(result), &centres(truth), alignment)?,
            result,
            truth,
        ))
    }

    /// Compares `result[i]` with `truth[i]` after aligning by centres and orientations.
    ///
    /// If the centres lie along a line, they hardly determine the rotation about that line. Squared
    /// distances and (small) angles are therefore summed; a radian counts as the root mean square
    /// distance of the centres from their centroid. Scale and translation are those of the centres.
    ///
    /// # Errors
    /// Same as [`Similarity::align`] for the camera centres, except that two cameras and collinear
    /// cameras are accepted.
    pub fn between_poses(
        result: &[Pose],
        truth: &[Pose],
        alignment: Alignment,
    ) -> Result<Self, GeometryError> {
        let of_cameras = |error| match error {
            GeometryError::TooFewPoints { kind, .. } => GeometryError::TooFewPoints {
                count: result.len(),
                kind,
            },
            other => other,
        };
        let by_pegs =
            Similarity::align(&pegs(result), &pegs(truth), alignment).map_err(of_cameras)?;
        let alignment = Similarity::turned(
            &centres(result),
            &centres(truth),
            by_pegs.rotation,
            alignment,
        );
        Ok(Self::after(alignment, result, truth))
    }

    fn after(alignment: Similarity, result: &[Pose], truth: &[Pose]) -> Self {
        let aligned: Vec<Pose> = result
            .iter()
            .map(|pose| alignment.transform_camera(pose))
            .collect();
        let truth_centres = centres(truth);
        let distances: Vec<f64> = aligned
            .iter()
            .zip(&truth_centres)
            .map(|(a, t)| a.centre().distance(*t))
            .collect();
        let turns = |poses: &[Pose]| {
            poses
                .iter()
                .map(|pose| pose.rotation)
                .collect::<Vec<DQuat>>()
        };
        let (own, wanted) = (turns(result), turns(truth));
        let between = mean_between(&own, &wanted);
        let laid: Vec<DQuat> = own.iter().map(|&turn| turn * between.conjugate()).collect();
        let centroid = mean(&truth_centres);
        Self {
            count: result.len(),
            alignment,
            centre: ErrorStatistics::of(&distances),
            rotation_deg: ErrorStatistics::of(&angles_deg(&turns(&aligned), &wanted)),
            own_rotation_deg: ErrorStatistics::of(&angles_deg(&laid, &wanted)),
            extent: truth_centres
                .iter()
                .map(|c| c.distance(centroid))
                .fold(0.0, f64::max),
        }
    }
}

fn centres(poses: &[Pose]) -> Vec<DVec3> {
    poses.iter().map(Pose::centre).collect()
}

fn mean(points: &[DVec3]) -> DVec3 {
    points.iter().sum::<DVec3>() / points.len().max(1) as f64
}

/// Returns, for each camera, the six ends of a cross along its axes.
///
/// If a camera is displaced, all six ends are displaced equally. If it is rotated by a small angle,
/// the sum of squares is as if it were displaced by that angle times the centres' distance from
/// their centroid.
fn pegs(poses: &[Pose]) -> Vec<DVec3> {
    let centres = centres(poses);
    let centroid = mean(&centres);
    let mean_square = centres
        .iter()
        .map(|c| c.distance_squared(centroid))
        .sum::<f64>()
        / centres.len().max(1) as f64;
    let arm = (1.5 * mean_square).sqrt();
    let ends = |pose: &Pose| {
        let (centre, back) = (pose.centre(), pose.rotation.conjugate());
        DVec3::AXES
            .map(|axis| arm * (back * axis))
            .map(|end| [centre + end, centre - end])
    };
    poses.iter().flat_map(ends).flatten().collect()
}

/// Returns the rotation of the world that best aligns all orientations with the true ones.
///
/// It minimises the sum of squared differences of the matrices.
fn mean_between(own: &[DQuat], wanted: &[DQuat]) -> DQuat {
    let between = own
        .iter()
        .zip(wanted)
        .map(|(&own, &wanted)| DMat3::from_quat(wanted.conjugate() * own));
    DQuat::from_mat3(&nearest_rotation(between.sum()))
}

/// Returns angles between rotations in degrees; exact for small angles too.
fn angles_deg(a: &[DQuat], b: &[DQuat]) -> Vec<f64> {
    let angle = |(a, b): (&DQuat, &DQuat)| {
        let between = a.conjugate() * *b;
        (2.0 * between.xyz().length().atan2(between.w.abs())).to_degrees()
    };
    a.iter().zip(b).map(angle).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    fn circle() -> Vec<Pose> {
        (0..12)
            .map(|i| {
                let rotation = DQuat::from_rotation_y(0.5 * f64::from(i))
                    * DQuat::from_rotation_x(0.1 * f64::from(i));
                Pose {
                    rotation,
                    translation: DVec3::new(0.1 * f64::from(i), 0.0, 2.0),
                }
            })
            .collect()
    }

    #[test]
    fn moved_and_scaled_trajectory_has_no_error_only_after_sim3() {
        let truth = circle();
        let world = Similarity {
            scale: 0.25,
            rotation: DQuat::from_rotation_x(1.2),
            translation: DVec3::new(5.0, 6.0, 7.0),
        };
        let result: Vec<Pose> = truth
            .iter()
            .map(|pose| world.transform_camera(pose))
            .collect();
        let error = TrajectoryMetrics::between(&result, &truth, Alignment::Sim3).unwrap();
        assert!(
            error.centre.max < 1e-9 && error.rotation_deg.max < 1e-6,
            "{error:?}"
        );
        assert!((error.alignment.scale - 4.0).abs() < 1e-9);
        let rigid = TrajectoryMetrics::between(&result, &truth, Alignment::Se3).unwrap();
        assert!(rigid.centre.rmse > 0.1 && rigid.rotation_deg.max < 1e-6);
        assert!(
            TrajectoryMetrics::between(&result, &truth, Alignment::None)
                .unwrap()
                .rotation_deg
                .mean
                > 10.0
        );
    }

    #[test]
    fn single_wrong_camera_shows_in_the_statistics() {
        let truth = circle();
        let mut result = truth.clone();
        let turn = Pose {
            rotation: DQuat::from_rotation_z(2f64.to_radians()),
            translation: DVec3::ZERO,
        };
        result[3] = turn.compose(&result[3]);
        let error = TrajectoryMetrics::between(&result, &truth, Alignment::None).unwrap();
        assert!((error.rotation_deg.max - 2.0).abs() < 1e-9 && error.rotation_deg.median < 1e-9);
        assert!((error.rotation_deg.mean - 2.0 / 12.0).abs() < 1e-9 && error.centre.max < 1e-12);
    }

    /// Returns cameras along the x axis that look in all directions.
    fn line() -> Vec<Pose> {
        let camera = |i: f64| {
            let rotation = DQuat::from_rotation_y(0.1 * i);
            Pose {
                rotation,
                translation: -(rotation * DVec3::new(i, 0.0, 0.0)),
            }
        };
        (0..12).map(f64::from).map(camera).collect()
    }

    #[test]
    fn orientations_determine_the_rotation_about_a_straight_path() {
        let truth = line();
        let world = Similarity {
            scale: 2.0,
            rotation: DQuat::from_rotation_x(0.8),
            translation: DVec3::new(1.0, 2.0, 3.0),
        };
        let result: Vec<Pose> = truth
            .iter()
            .map(|pose| world.transform_camera(pose))
            .collect();
        assert!(
            TrajectoryMetrics::between(&result, &truth, Alignment::Sim3).is_err(),
            "a line"
        );
        for count in [2, 12] {
            let error = TrajectoryMetrics::between_poses(
                &result[..count],
                &truth[..count],
                Alignment::Sim3,
            )
            .unwrap();
            assert!(
                error.centre.max < 1e-9 && error.rotation_deg.max < 1e-6,
                "{error:?}"
            );
            assert!((error.alignment.scale - 0.5).abs() < 1e-9);
        }
        let in_one_place = vec![Pose::IDENTITY; 5];
        let error = TrajectoryMetrics::between_poses(&in_one_place, &in_one_place, Alignment::Se3)
            .unwrap_err();
        assert!(
            matches!(error, GeometryError::TooFewPoints { count: 5, .. }),
            "{error}"
        );
    }

    #[test]
    fn contradicting_centres_and_orientations_are_balanced() {
        let (truth, angle) = (line(), 0.01);
        let turned = |pose: &Pose| {
            let centre = DQuat::from_rotation_z(angle) * pose.centre();
            Pose {
                translation: -(pose.rotation * centre),
                ..*pose
            }
        };
        let result: Vec<Pose> = truth.iter().map(turned).collect();
        let error = TrajectoryMetrics::between_poses(&result, &truth, Alignment::Se3).unwrap();
        assert!(
            (error.rotation_deg.median.to_radians() - angle / 2.0).abs() < 1e-5,
            "{error:?}"
        );
    }

    #[test]
    fn own_rotation_error_does_not_depend_on_the_centres() {
        let truth = circle();
        let turned = |(i, pose): (usize, &Pose)| {
            // All centres rotated about a line elsewhere, all orientations rotated equally, every
            // third camera a little more.
            let more = if i % 3 == 0 { 0.02 } else { 0.0 };
            let rotation =
                DQuat::from_rotation_z(more) * pose.rotation * DQuat::from_rotation_y(2.0);
            Pose {
                rotation,
                translation: -(rotation * (DQuat::from_rotation_x(1.0) * pose.centre())),
            }
        };
        let result: Vec<Pose> = truth.iter().enumerate().map(turned).collect();
        let error = TrajectoryMetrics::between(&result, &truth, Alignment::Se3).unwrap();
        assert!(error.rotation_deg.mean > 10.0, "{error:?}");
        let [median, max] =
            [error.own_rotation_deg.median, error.own_rotation_deg.max].map(f64::to_radians);
        assert!(median < 0.002 && (0.018..0.022).contains(&max), "{error:?}");
        let none = TrajectoryMetrics::between(&[], &[], Alignment::None).unwrap();
        assert_eq!(none.own_rotation_deg, ErrorStatistics::default());
    }

    #[test]
    fn statistics_match_values_computed_by_hand() {
        let statistics = ErrorStatistics::of(&[4.0, 1.0, 2.0, 1.0]);
        assert_eq!(
            (statistics.mean, statistics.median, statistics.max),
            (2.0, 1.5, 4.0)
        );
        assert!((statistics.rmse - 5.5f64.sqrt()).abs() < 1e-12);
    }
}

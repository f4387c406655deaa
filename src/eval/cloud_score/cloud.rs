use glam::{DVec3, Vec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::in_depth::{FeatureViews, differences_by_features, differences_by_guess};
use super::labels::{CloudLabelScore, pair_labels, score_labels};
use ostra_cloud::points::Neighbours;
use ostra_cloud::{LabelledCloud, SceneError};
use ostra_core::job::Progress;
use ostra_core::statistics::upper_median;
use ostra_frames::FrameCamera;
use ostra_geometry::Similarity;

/// Options for scoring a cloud against the ground truth.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CloudScoreOptions {
    /// Distances in cloud units, above 0.
    ///
    /// The surface is scored at each of them. The first one is the maximum distance for matching
    /// labels; without any, every ground truth point matches its nearest point.
    pub within: Vec<f64>,
    /// Depth in the label tree (1 = top) at which labels are compared; `None` compares the deepest.
    pub level: Option<usize>,
    /// Cameras in the coordinates of the ground truth.
    ///
    /// Only points inside at least `min_views` of their frustums count.
    pub cameras: Vec<FrameCamera>,
    /// Minimum number of frustums around a ground truth point; 0 counts every point.
    pub min_views: usize,
    /// Features that show which ground truth points a camera sees, for the comparison in depth.
    ///
    /// `None` uses the points in the frustums of `cameras` that are not occluded.
    pub images: Option<FeatureViews>,
    /// Transform of the result into the coordinates of the ground truth.
    pub truth_from_result: Option<Similarity>,
}

/// Score of a cloud.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CloudScore {
    /// Number of ground truth points that count.
    pub truth_points: usize,
    /// Number of result points.
    pub result_points: usize,
    /// Labels of the ground truth points compared with those of their nearest result points.
    pub labels: CloudLabelScore,
    /// Median distance from a ground truth point to the nearest result point, in cloud units.
    pub median_distance: f64,
    /// Number of pairs of a result point and a ground truth point that were compared in depth.
    ///
    /// There is one pair for each camera that sees both; `None` without cameras.
    #[serde(default)]
    pub compared_in_depth: Option<usize>,
    /// Score of the surface at each distance.
    pub surface: Vec<SurfaceScore>,
}

/// Scores `result` against `truth`.
///
/// Each ground truth point takes the label of the nearest result point, or 0 if that is farther
/// than the first distance.
///
/// # Errors
/// Returns [`SceneError::Request`] if a cloud is empty, if a distance is not above 0, if no ground
/// truth point is inside enough frustums, or if the images show none. Returns
/// [`SceneError::Stopped`] if stopped.
pub fn score_cloud(
    truth: &LabelledCloud,
    result: &LabelledCloud,
    options: &CloudScoreOptions,
    progress: &Progress,
) -> Result<CloudScore, SceneError> {
    progress.stage("score")?;
    if let Some(bad) = options
        .within
        .iter()
        .find(|within| !(within.is_finite() && **within > 0.0))
    {
        return Err(SceneError::Request(format!(
            "a distance of {bad} is not possible; give lengths above 0"
        )));
    }
    let truth = counted_truth(&at_level(truth, options.level), options)?;
    let result = aligned(&at_level(result, options.level), options.truth_from_result);
    let empty =
        || SceneError::Request("a cloud without points cannot be scored; check both files".into());
    let (in_result, in_truth) = Neighbours::new(&result.positions)
        .zip(Neighbours::new(&truth.all))
        .ok_or_else(empty)?;
    let to_result = distances(&truth.cloud.positions, &in_result, progress)?;
    let to_truth = distances(&result.positions, &in_truth, progress)?;
    let in_depth = match &options.images {
        Some(views) => differences_by_features(&truth.all, &result.positions, views, progress)?,
        None => differences_by_guess(&truth.all, &result.positions, &options.cameras, progress)?,
    };
    let has_cameras = options.images.is_some() || !options.cameras.is_empty();
    let first = options.within.first().copied().unwrap_or(f64::INFINITY);
    let paired = pair_labels(&truth.cloud.tree, &result.tree);
    let taken = to_result
        .iter()
        .map(|&(index, distance)| match f64::from(distance) <= first {
            true => {
                let label = result.labels[index];
                Some(paired.get(&label).copied().unwrap_or(label))
            }
            false => None,
        });
    let mut distances: Vec<f32> = to_result.iter().map(|&(_, distance)| distance).collect();
    Ok(CloudScore {
        truth_points: truth.cloud.len(),
        result_points: result.len(),
        labels: score_labels(&truth.cloud, taken, &result.tree, &paired),
        median_distance: upper_median(&mut distances).map_or(0.0, f64::from),
        compared_in_depth: has_cameras.then_some(in_depth.len()),
        surface: options
            .within
            .iter()
            .map(|&at| score_surface(at, &to_result, &to_truth, &in_depth))
            .collect(),
    })
}

/// The ground truth points that count, and the positions of all ground truth points.
struct CountedTruth {
    cloud: LabelledCloud,
    all: Vec<Vec3>,
}

fn counted_truth(
    truth: &LabelledCloud,
    options: &CloudScoreOptions,
) -> Result<CountedTruth, SceneError> {
    let all = truth.positions.clone();
    if options.min_views == 0 {
        return Ok(CountedTruth {
            cloud: truth.clone(),
            all,
        });
    }
    let views = inside_frusta(&all, &options.cameras);
    let inside: Vec<u32> = (0..all.len() as u32)
        .filter(|&p| views[p as usize] as usize >= options.min_views)
        .collect();
    if inside.is_empty() {
        return Err(SceneError::Request(format!(
            "no truth point lies inside {} of the {} frusta; check that the cameras belong to the truth, or ask for fewer",
            options.min_views,
            options.cameras.len()
        )));
    }
    Ok(CountedTruth {
        cloud: truth.select(&inside),
        all,
    })
}

fn at_level(cloud: &LabelledCloud, level: Option<usize>) -> LabelledCloud {
    level.map_or_else(|| cloud.clone(), |level| cloud.at_level(level))
}

fn aligned(cloud: &LabelledCloud, transform: Option<Similarity>) -> LabelledCloud {
    let Some(transform) = transform else {
        return cloud.clone();
    };
    let moved = cloud
        .positions
        .iter()
        .map(|position| transform.transform(position.as_dvec3()).as_vec3());
    LabelledCloud {
        positions: moved.collect(),
        ..cloud.clone()
    }
}

fn distances(
    points: &[Vec3],
    to: &Neighbours,
    progress: &Progress,
) -> Result<Vec<(usize, f32)>, SceneError> {
    let chunks: Vec<Vec<(usize, f32)>> = points
        .par_chunks(4096)
        .map(|chunk| {
            progress
                .check()
                .map(|()| chunk.iter().map(|&point| to.nearest(point)).collect())
        })
        .collect::<Result<_, _>>()?;
    Ok(chunks.concat())
}

/// Agreement of two surfaces at one distance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SurfaceScore {
    /// The distance, in cloud units.
    pub within: f64,
    /// Share of the ground truth points with a result point within the distance.
    pub completeness: f64,
    /// Share of the result points with a ground truth point within the distance.
    pub accuracy: f64,
    /// Harmonic mean of both.
    pub f_score: f64,
    /// Share of the compared result points whose depth difference is within the distance.
    ///
    /// A result point is compared if a camera sees it within a pixel of a ground truth point that
    /// it also sees. `None` if there are no such points.
    pub in_depth: Option<f64>,
}

/// Scores the surface at one distance.
///
/// Inputs are the distances from ground truth to result and back, and the depth differences of
/// compared points.
fn score_surface(
    within: f64,
    to_result: &[(usize, f32)],
    to_truth: &[(usize, f32)],
    depth_differences: &[f32],
) -> SurfaceScore {
    let share = |distances: &[(usize, f32)]| {
        let near = distances
            .iter()
            .filter(|&&(_, distance)| f64::from(distance) <= within)
            .count();
        near as f64 / distances.len().max(1) as f64
    };
    let (completeness, accuracy) = (share(to_result), share(to_truth));
    let sum = completeness + accuracy;
    let f_score = if sum > 0.0 {
        2.0 * completeness * accuracy / sum
    } else {
        0.0
    };
    let near = depth_differences
        .iter()
        .filter(|&&difference| f64::from(difference) <= within)
        .count();
    let in_depth =
        (!depth_differences.is_empty()).then(|| near as f64 / depth_differences.len() as f64);
    SurfaceScore {
        within,
        completeness,
        accuracy,
        f_score,
        in_depth,
    }
}

/// Returns how many cameras have each point inside their image, occluded or not.
#[must_use]
pub fn inside_frusta(points: &[Vec3], cameras: &[FrameCamera]) -> Vec<u32> {
    let count = |point: &Vec3| {
        cameras
            .iter()
            .filter(|camera| sees(camera, point.as_dvec3()))
            .count() as u32
    };
    points.par_iter().map(count).collect()
}

fn sees(camera: &FrameCamera, x_in_world: DVec3) -> bool {
    let Some(pose) = &camera.camera_from_world else {
        return false;
    };
    let (width, height) = (
        f64::from(camera.intrinsics.width),
        f64::from(camera.intrinsics.height),
    );
    let at = camera.intrinsics.project(pose.transform(x_in_world));
    at.is_some_and(|px| px.x >= 0.0 && px.y >= 0.0 && px.x < width && px.y < height)
}

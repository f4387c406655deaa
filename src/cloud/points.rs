//! Operations on bare points: neighbours, spacing, outliers, normals, downsampling.

use std::collections::BTreeMap;
use std::num::NonZero;

use glam::{DVec3, I64Vec3, Vec3};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::{LabelledCloud, SceneError};
use ostra_core::job::Progress;
use ostra_core::statistics::upper_median;
use ostra_masks::LabelId;

/// Maximum number of points sampled by [`spacing`].
const SPACING_SAMPLES: usize = 2000;

/// A k-d tree over points.
pub struct Neighbours {
    tree: ImmutableKdTree<f32, 3>,
    count: usize,
}

impl std::fmt::Debug for Neighbours {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Neighbours")
            .field("count", &self.count)
            .finish_non_exhaustive()
    }
}

impl Neighbours {
    /// Builds the tree, or returns `None` if there are no points.
    ///
    /// Non-finite points are excluded from all queries.
    #[must_use]
    pub fn new(points: &[Vec3]) -> Option<Self> {
        // Far enough not to be found, and near enough for the squared distance to be a finite
        // number.
        let place = |point: &Vec3| {
            if point.is_finite() {
                point.to_array()
            } else {
                [1e18; 3]
            }
        };
        let places: Vec<[f32; 3]> = points.iter().map(place).collect();
        if places.is_empty() {
            return None;
        }
        let tree = ImmutableKdTree::new_from_slice(&places).ok()?;
        Some(Self {
            tree,
            count: points.len(),
        })
    }

    /// Returns the nearest point as (index, distance).
    #[must_use]
    pub fn nearest(&self, to: Vec3) -> (usize, f32) {
        let found = self
            .tree
            .query(&to.to_array())
            .nearest_one::<SquaredEuclidean<f32>>()
            .execute();
        (found.item as usize, found.distance.sqrt())
    }

    /// Returns the up to `count` nearest points as (index, distance), nearest first.
    #[must_use]
    pub fn nearest_n(&self, to: Vec3, count: usize) -> Vec<(usize, f32)> {
        let Some(count) = NonZero::new(count.min(self.count)) else {
            return Vec::new();
        };
        let found = self
            .tree
            .query(&to.to_array())
            .nearest_n::<SquaredEuclidean<f32>>(count)
            .execute();
        found
            .iter()
            .map(|one| (one.item as usize, one.distance.sqrt()))
            .collect()
    }

    /// Returns the same as [`spacing`]; `points` are those that the tree was built from.
    #[must_use]
    pub fn spacing(&self, points: &[Vec3]) -> Option<f64> {
        let step = points.len().div_ceil(SPACING_SAMPLES).max(1);
        let nearest_other = |&point: &Vec3| {
            let around = self.nearest_n(point, 8);
            around
                .into_iter()
                .map(|(_, distance)| distance)
                .find(|&distance| distance > 0.0 && distance < 1e17)
        };
        let mut distances: Vec<f32> = points
            .iter()
            .filter(|p| p.is_finite())
            .step_by(step)
            .filter_map(nearest_other)
            .collect();
        upper_median(&mut distances).map(f64::from)
    }
}

/// Returns the typical distance between neighbouring points.
///
/// This is the median distance of a point to the nearest one at another position. Returns `None` if
/// there are fewer than two distinct positions.
#[must_use]
pub fn spacing(points: &[Vec3]) -> Option<f64> {
    Neighbours::new(points)?.spacing(points)
}

/// Options of statistical outlier detection.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct OutlierOptions {
    /// Number of neighbours whose mean distance is computed; at least 1.
    pub neighbours: usize,
    /// Number of standard deviations above the mean that makes an outlier; 0 or more.
    pub std_ratio: f64,
}

impl Default for OutlierOptions {
    fn default() -> Self {
        Self {
            neighbours: 16,
            std_ratio: 2.0,
        }
    }
}

/// Returns for each point whether it is a statistical outlier.
///
/// A point is an outlier if the mean distance to its neighbours exceeds the mean over all points by
/// more than `std_ratio` standard deviations. See Rusu, Marton, Blodow, Dolha, Beetz: *Towards 3D
/// point cloud based object maps for household environments*, Robotics and Autonomous Systems 2008.
///
/// # Errors
///
/// Returns [`SceneError::Stopped`] if the job is stopped.
pub fn outliers(
    points: &[Vec3],
    options: &OutlierOptions,
    progress: &Progress,
) -> Result<Vec<bool>, SceneError> {
    progress.stage("outliers")?;
    let Some(neighbours) = Neighbours::new(points) else {
        return Ok(Vec::new());
    };
    let mean_distance = |&point: &Vec3| {
        // The nearest point is the point itself.
        let around = neighbours.nearest_n(point, options.neighbours.max(1) + 1);
        let others = around.get(1..).unwrap_or_default();
        others
            .iter()
            .map(|&(_, distance)| f64::from(distance))
            .sum::<f64>()
            / others.len().max(1) as f64
    };
    let distances: Vec<Vec<f64>> = points
        .par_chunks(4096)
        .map(|chunk| {
            progress
                .check()
                .map(|()| chunk.iter().map(mean_distance).collect())
        })
        .collect::<Result<_, _>>()?;
    let distances: Vec<f64> = distances.concat();
    let count = distances.len() as f64;
    let mean = distances.iter().sum::<f64>() / count;
    let variance = distances
        .iter()
        .map(|distance| (distance - mean).powi(2))
        .sum::<f64>()
        / count;
    let limit = mean + options.std_ratio * variance.sqrt();
    Ok(distances.iter().map(|&distance| distance > limit).collect())
}

/// Options of normal estimation from points alone.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct NormalOptions {
    /// Number of nearest points for the plane fit, including the point itself; at least 3.
    pub neighbours: usize,
}

impl Default for NormalOptions {
    fn default() -> Self {
        Self { neighbours: 16 }
    }
}

/// Estimates the unit normals of the planes that best fit each point's neighbours.
///
/// The method is that of Hoppe et al., *Surface reconstruction from unorganized points* (SIGGRAPH
/// 1992). Normals point towards the nearest of the `viewpoints` (camera centres), or away from the
/// centroid of the cloud if there are none. The normal is zero if the neighbours are collinear or
/// coincident.
///
/// # Errors
///
/// Returns [`SceneError::Stopped`] if the job is stopped.
pub fn estimate_normals(
    points: &[Vec3],
    viewpoints: &[Vec3],
    options: &NormalOptions,
    progress: &Progress,
) -> Result<Vec<Vec3>, SceneError> {
    progress.stage("normals")?;
    let Some(neighbours) = Neighbours::new(points) else {
        return Ok(Vec::new());
    };
    let middle = points
        .iter()
        .map(|point| point.as_dvec3())
        .sum::<glam::DVec3>()
        / points.len() as f64;
    let eyes = Neighbours::new(viewpoints);
    let normal = |&point: &Vec3| {
        let around = neighbours.nearest_n(point, options.neighbours.max(3));
        let normal = plane_normal(around.iter().map(|&(index, _)| points[index]));
        let outwards = match &eyes {
            Some(eyes) => viewpoints[eyes.nearest(point).0] - point,
            None => point - middle.as_vec3(),
        };
        if normal.dot(outwards) < 0.0 {
            -normal
        } else {
            normal
        }
    };
    let chunks: Vec<Vec<Vec3>> = points
        .par_chunks(4096)
        .map(|chunk| {
            progress
                .check()
                .map(|()| chunk.iter().map(normal).collect())
        })
        .collect::<Result<_, _>>()?;
    Ok(chunks.concat())
}

/// Returns the direction of least spread of the points, or zero if it is not unique.
fn plane_normal(points: impl Iterator<Item = Vec3> + Clone) -> Vec3 {
    let exact = |point: Vec3| Vector3::from(point.as_dvec3().to_array());
    let count = points.clone().count() as f64;
    let mean = points.clone().map(exact).sum::<Vector3<f64>>() / count;
    let spread: Matrix3<f64> = points
        .map(|point| (exact(point) - mean) * (exact(point) - mean).transpose())
        .sum();
    let eigen = spread.symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
    let [least, second, most] = order.map(|index| eigen.eigenvalues[index].max(0.0));
    // On a line, the spread is equally small in two directions.
    if second - least <= 1e-9 * most || most <= 0.0 {
        return Vec3::ZERO;
    }
    let direction = eigen.eigenvectors.column(order[0]);
    Vec3::new(
        direction[0] as f32,
        direction[1] as f32,
        direction[2] as f32,
    )
    .normalize_or_zero()
}

/// Reduces a cloud to one point per occupied cube of edge length `voxel`.
///
/// Positions, colours and normals are averaged. The label is the one that most of the points have,
/// and the smaller id in a tie. Its confidence is the sum of its confidences divided by the number
/// of all points in the cube.
///
/// # Errors
///
/// Returns [`SceneError::Request`] if the edge length is not above 0.
pub fn downsample(cloud: &LabelledCloud, voxel: f64) -> Result<LabelledCloud, SceneError> {
    if !(voxel.is_finite() && voxel > 0.0) {
        return Err(SceneError::Request(format!(
            "a voxel size of {voxel} is not possible; give a length above 0"
        )));
    }
    let cell = |position: &Vec3| {
        let I64Vec3 { x, y, z } = (position.as_dvec3() / voxel).floor().as_i64vec3();
        (z, y, x)
    };
    let mut order: Vec<((i64, i64, i64), u32)> = cloud
        .positions
        .iter()
        .enumerate()
        .map(|(index, position)| (cell(position), index as u32))
        .collect();
    order.par_sort_unstable();
    let mut thin = LabelledCloud {
        tree: cloud.tree.clone(),
        origin: cloud.origin,
        ..LabelledCloud::default()
    };
    for group in order.chunk_by(|a, b| a.0 == b.0) {
        let members: Vec<usize> = group.iter().map(|&(_, index)| index as usize).collect();
        push_mean(&mut thin, cloud, &members);
    }
    Ok(thin)
}

fn push_mean(thin: &mut LabelledCloud, cloud: &LabelledCloud, members: &[usize]) {
    let count = members.len() as f64;
    let sum = |of: &dyn Fn(usize) -> DVec3| members.iter().map(|&index| of(index)).sum::<DVec3>();
    let color = sum(&|index| DVec3::from_array(cloud.colors[index].map(f64::from))) / count;
    let (label, confidence) = winner(cloud, members);
    thin.positions
        .push((sum(&|index| cloud.positions[index].as_dvec3()) / count).as_vec3());
    thin.normals.push(
        sum(&|index| cloud.normals[index].as_dvec3())
            .as_vec3()
            .normalize_or_zero(),
    );
    thin.colors
        .push(color.to_array().map(|channel| channel.round() as u8));
    thin.labels.push(label);
    thin.confidence.push((confidence / count) as f32);
}

/// Returns the label that most members have, and the sum of its confidences.
fn winner(cloud: &LabelledCloud, members: &[usize]) -> (LabelId, f64) {
    let mut votes: BTreeMap<LabelId, (usize, f64)> = BTreeMap::new();
    for &index in members {
        let (count, confidence) = votes.entry(cloud.labels[index]).or_default();
        *count += 1;
        *confidence += f64::from(cloud.confidence[index]);
    }
    let best = votes.iter().rev().max_by_key(|(_, (count, _))| *count);
    best.map_or((LabelId::NONE, 0.0), |(&id, &(_, confidence))| {
        (id, confidence)
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn queries_agree_with_a_linear_search(raw in prop::collection::vec(prop::array::uniform3(-4i8..4), 1..200), to in prop::array::uniform3(-6i8..6)) {
            let point = |p: &[i8; 3]| Vec3::from_array(p.map(f32::from));
            let points: Vec<Vec3> = raw.iter().map(point).collect();
            let to = point(&to);
            let neighbours = Neighbours::new(&points).unwrap();
            let mut plain: Vec<f32> = points.iter().map(|p| p.distance(to)).collect();
            plain.sort_by(f32::total_cmp);
            let (index, distance) = neighbours.nearest(to);
            prop_assert!((distance - plain[0]).abs() < 1e-5 && (points[index].distance(to) - distance).abs() < 1e-5);
            let found = neighbours.nearest_n(to, 7);
            prop_assert_eq!(found.len(), points.len().min(7));
            for (one, expected) in found.iter().zip(&plain) {
                prop_assert!((one.1 - expected).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn spacing_of_a_lattice_is_its_step() {
        let points: Vec<Vec3> = (0..1000)
            .map(|i| Vec3::new((i % 10) as f32, (i / 10 % 10) as f32, (i / 100) as f32) * 0.25)
            .collect();
        assert_eq!(spacing(&points), Some(0.25));
        assert_eq!(spacing(&[Vec3::ONE, Vec3::NAN, Vec3::ONE]), None);
        assert_eq!(spacing(&[]), None);
    }

    #[test]
    fn coincident_points_can_be_queried() {
        let neighbours = Neighbours::new(&vec![Vec3::ONE; 5000]).unwrap();
        assert_eq!(neighbours.nearest(Vec3::ZERO).1, 3f32.sqrt());
        assert_eq!(neighbours.nearest_n(Vec3::ZERO, 40).len(), 40);
    }

    #[test]
    fn isolated_points_are_outliers() {
        let mut points: Vec<Vec3> = (0..900)
            .map(|i| Vec3::new((i % 30) as f32, (i / 30) as f32, 0.0))
            .collect();
        points.push(Vec3::new(15.0, 15.0, 9.0));
        points.push(Vec3::new(-12.0, 4.0, 0.0));
        let far = outliers(&points, &OutlierOptions::default(), &Progress::default()).unwrap();
        let found: Vec<usize> = (0..far.len()).filter(|&i| far[i]).collect();
        assert_eq!(found, [900, 901]);
        assert_eq!(
            outliers(&[], &OutlierOptions::default(), &Progress::default()).unwrap(),
            Vec::<bool>::new()
        );
        assert_eq!(
            outliers(
                &[Vec3::ONE],
                &OutlierOptions::default(),
                &Progress::default()
            )
            .unwrap(),
            [false]
        );
    }

    fn sphere() -> Vec<Vec3> {
        let golden = std::f32::consts::PI * (3.0 - 5f32.sqrt());
        let point = |i: u16| {
            let y = 1.0 - f32::from(i) / 999.5;
            let angle = golden * f32::from(i);
            Vec3::new(
                angle.cos() * (1.0 - y * y).max(0.0).sqrt(),
                y,
                angle.sin() * (1.0 - y * y).max(0.0).sqrt(),
            )
        };
        (0..2000).map(point).collect()
    }

    #[test]
    fn normals_point_outwards_or_towards_the_camera() {
        let points = sphere();
        let out = estimate_normals(
            &points,
            &[],
            &NormalOptions::default(),
            &Progress::default(),
        )
        .unwrap();
        assert!(
            points
                .iter()
                .zip(&out)
                .all(|(point, normal)| point.dot(*normal) > 0.99)
        );
        let inwards = estimate_normals(
            &points,
            &[Vec3::ZERO],
            &NormalOptions::default(),
            &Progress::default(),
        )
        .unwrap();
        assert!(
            points
                .iter()
                .zip(&inwards)
                .all(|(point, normal)| point.dot(*normal) < -0.99)
        );
    }

    #[test]
    fn points_on_a_line_have_no_normals() {
        let line: Vec<Vec3> = (0..50).map(|i| Vec3::X * i as f32).collect();
        let normals =
            estimate_normals(&line, &[], &NormalOptions::default(), &Progress::default()).unwrap();
        assert!(normals.iter().all(|normal| *normal == Vec3::ZERO));
    }

    #[test]
    fn downsampling_averages_points_and_takes_the_majority_label() {
        let mut cloud = LabelledCloud::from_positions(vec![
            Vec3::new(0.1, 0.0, 0.0),
            Vec3::new(2.5, 0.0, 0.0),
            Vec3::new(0.3, 0.0, 0.0),
            Vec3::new(0.8, 0.3, 0.0),
        ]);
        cloud.labels = vec![LabelId(5), LabelId(0), LabelId(2), LabelId(5)];
        cloud.confidence = vec![1.0, 0.0, 0.9, 0.5];
        cloud.colors = vec![[0; 3], [9; 3], [100; 3], [200; 3]];
        let thin = downsample(&cloud, 1.0).unwrap();
        assert_eq!(
            thin.positions,
            [Vec3::new(0.4, 0.1, 0.0), Vec3::new(2.5, 0.0, 0.0)]
        );
        assert_eq!(thin.labels, [LabelId(5), LabelId(0)]);
        assert_eq!(thin.confidence, [0.5, 0.0]);
        assert_eq!(thin.colors, [[100; 3], [9; 3]]);
        assert!(downsample(&cloud, 0.0).is_err() && downsample(&cloud, f64::NAN).is_err());
    }

    #[test]
    fn tie_goes_to_the_smaller_id() {
        let mut cloud = LabelledCloud::from_positions(vec![Vec3::ZERO; 2]);
        cloud.labels = vec![LabelId(7), LabelId(3)];
        assert_eq!(downsample(&cloud, 1.0).unwrap().labels, [LabelId(3)]);
    }
}

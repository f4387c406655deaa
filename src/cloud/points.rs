//! Verbs on bare points: neighbours, spacing, outliers, normals, thinning.

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

/// Points whose distance to their neighbour is measured for [`spacing`].
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
    /// Builds the tree; `None` without points. Points that are not finite are never anybody's neighbour.
    #[must_use]
    pub fn new(points: &[Vec3]) -> Option<Self> {
        // So far away that it is not found, so near that its distance is still a number.
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

    /// The nearest point, as (index, distance).
    #[must_use]
    pub fn nearest(&self, to: Vec3) -> (usize, f32) {
        let found = self
            .tree
            .query(&to.to_array())
            .nearest_one::<SquaredEuclidean<f32>>()
            .execute();
        (found.item as usize, found.distance.sqrt())
    }

    /// The `count` nearest points (fewer where there are not as many), nearest first, as (index, distance).
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

    /// As [`spacing`], of the points that the tree was built of.
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

/// How far apart neighbours typically are: the median distance of a point to the nearest at another place; `None` for
/// fewer than two places.
#[must_use]
pub fn spacing(points: &[Vec3]) -> Option<f64> {
    Neighbours::new(points)?.spacing(points)
}

/// Which points lie apart from all others.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct OutlierOptions {
    /// Neighbours whose mean distance is taken; at least 1.
    pub neighbours: usize,
    /// Standard deviations above the mean of all points at which a point is an outlier; 0 or more.
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

/// Statistical outlier removal (Rusu, Marton, Blodow, Dolha, Beetz: *Towards 3D point cloud based object maps for
/// household environments*, Robotics and Autonomous Systems 2008): says for each point whether the mean distance to its
/// neighbours is above that of all points by more than so many standard deviations.
///
/// # Errors
/// [`SceneError::Stopped`].
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
        // The nearest of all is the point itself.
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

/// How normals are found from points alone.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct NormalOptions {
    /// Nearest points that a plane is laid through, the point itself among them; at least 3.
    pub neighbours: usize,
}

impl Default for NormalOptions {
    fn default() -> Self {
        Self { neighbours: 16 }
    }
}

/// Unit normals of the planes that fit each point's neighbours best (Hoppe et al., *Surface reconstruction from
/// unorganized points*, SIGGRAPH 1992), turned towards the nearest of the `viewpoints` (camera centres), or without any
/// away from the middle of the cloud. Zero where the neighbours lie in a line or a point.
///
/// # Errors
/// [`SceneError::Stopped`].
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

/// The direction in which the points spread least; zero where that is not one direction.
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
    // In a line two directions spread equally little.
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

/// One point for each cube of edge `voxel` that holds points: mean position, colour and normal; the label that most of
/// its points have (the smaller id in a tie), and as confidence the sum of that label's confidences over all its points.
///
/// # Errors
/// [`SceneError::Request`] for an edge that is no length above 0.
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

/// The label that most members have, and the sum of their confidences.
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
        fn nearest_is_nearest(raw in prop::collection::vec(prop::array::uniform3(-4i8..4), 1..200), to in prop::array::uniform3(-6i8..6)) {
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
    fn spacing_of_a_lattice() {
        let points: Vec<Vec3> = (0..1000)
            .map(|i| Vec3::new((i % 10) as f32, (i / 10 % 10) as f32, (i / 100) as f32) * 0.25)
            .collect();
        assert_eq!(spacing(&points), Some(0.25));
        assert_eq!(spacing(&[Vec3::ONE, Vec3::NAN, Vec3::ONE]), None);
        assert_eq!(spacing(&[]), None);
    }

    #[test]
    fn many_points_in_one_place() {
        let neighbours = Neighbours::new(&vec![Vec3::ONE; 5000]).unwrap();
        assert_eq!(neighbours.nearest(Vec3::ZERO).1, 3f32.sqrt());
        assert_eq!(neighbours.nearest_n(Vec3::ZERO, 40).len(), 40);
    }

    #[test]
    fn what_lies_apart_is_found() {
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
    fn a_sphere_points_outwards_and_towards_a_camera_inside_inwards() {
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
    fn a_line_has_no_normal() {
        let line: Vec<Vec3> = (0..50).map(|i| Vec3::X * i as f32).collect();
        let normals =
            estimate_normals(&line, &[], &NormalOptions::default(), &Progress::default()).unwrap();
        assert!(normals.iter().all(|normal| *normal == Vec3::ZERO));
    }

    #[test]
    fn means_and_majority() {
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
    fn a_tie_goes_to_the_smaller_id() {
        let mut cloud = LabelledCloud::from_positions(vec![Vec3::ZERO; 2]);
        cloud.labels = vec![LabelId(7), LabelId(3)];
        assert_eq!(downsample(&cloud, 1.0).unwrap().labels, [LabelId(3)]);
    }
}

use glam::Vec3;
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::neighbours::Neighbours;
use crate::SceneError;
use ostra_core::job::Progress;

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

#[cfg(test)]
mod tests {
    use super::*;

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
}

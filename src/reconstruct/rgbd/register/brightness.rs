use glam::{DMat2, DVec2, Vec3};

use super::oriented::OrientedCloud;
use ostra_cloud::points::Neighbours;

/// Points that a slope is fitted to.
const NEIGHBOURS: usize = 20;
/// Fewer give no slope.
const MIN_NEIGHBOURS: usize = 5;
/// How far they may be, in voxels.
const RADIUS: f32 = 2.5;

/// How brightness changes along the surface at a point: the vector in the tangent plane whose product with a step is the
/// change of intensity, by least squares over the neighbours; zero where there are too few.
pub fn slope(cloud: &OrientedCloud, tree: &Neighbours, index: usize, voxel: f32) -> Vec3 {
    let (here, normal) = (cloud.positions[index], cloud.normals[index]);
    if normal == Vec3::ZERO {
        return Vec3::ZERO;
    }
    let (along, across) = normal.any_orthonormal_pair();
    let (mut matrix, mut right, mut count) = (DMat2::ZERO, DVec2::ZERO, 0);
    for (other, distance) in tree.nearest_n(here, NEIGHBOURS) {
        if distance > 0.0 && distance < RADIUS * voxel {
            let step = cloud.positions[other] - here;
            let step = DVec2::new(f64::from(step.dot(along)), f64::from(step.dot(across)));
            matrix += DMat2::from_cols(step * step.x, step * step.y);
            right += step * f64::from(cloud.intensities[other] - cloud.intensities[index]);
            count += 1;
        }
    }
    let spread = matrix.x_axis.x + matrix.y_axis.y;
    // Neighbours in a line do not tell the slope across it.
    if count < MIN_NEIGHBOURS || matrix.determinant() < 1e-3 * spread * spread {
        return Vec3::ZERO;
    }
    let slope = (matrix.inverse() * right).as_vec2();
    slope.x * along + slope.y * across
}

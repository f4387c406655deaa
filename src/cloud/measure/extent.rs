use glam::DVec3;
use nalgebra::{Matrix3, SymmetricEigen};

use super::hull::hull_volume;
use super::table::Trait;
use super::unit::Dimension::{Area, Length, Volume};
use super::voxel_volume::voxel_volume;

/// Area, volumes, and sizes along the axes of the world and of the points; `spacing`: of the points.
pub(super) fn extent_traits(points: &[DVec3], area: f64, spacing: f64) -> Vec<Trait> {
    let count = points.len();
    let found = |name, value, definition| Trait::new(name, value, definition, count);
    let mut traits = vec![
        found(
            "area",
            (area, Area),
            "area of the surface that the points cover, one side of a thin sheet",
        ),
        found(
            "hull_volume",
            (hull_volume(points), Volume),
            "volume of the convex hull of the points",
        ),
        found(
            "voxel_volume",
            (voxel_volume(points, spacing), Volume),
            "voxels that the points enclose, and half of those that hold points; edge 3 spacings",
        ),
    ];
    for (name, size) in ["size_long", "size_middle", "size_short"]
        .into_iter()
        .zip(principal_sizes(points))
    {
        let definition = "size of the box along the principal axes of the points, longest first";
        traits.push(found(name, (size, Length), definition));
    }
    for (name, size) in ["box_x", "box_y", "box_z"]
        .into_iter()
        .zip(box_sizes(points).to_array())
    {
        traits.push(found(
            name,
            (size, Length),
            "size of the box along the axes of the world",
        ));
    }
    traits
}

fn box_sizes(points: &[DVec3]) -> DVec3 {
    let Some(&first) = points.first() else {
        return DVec3::ZERO;
    };
    let (low, high) = points
        .iter()
        .fold((first, first), |(low, high), &x| (low.min(x), high.max(x)));
    high - low
}

/// Extents along the principal axes, longest first.
fn principal_sizes(points: &[DVec3]) -> [f64; 3] {
    let (mean, scatter) = scattered(points);
    let axes = SymmetricEigen::new(scatter).eigenvectors;
    let mut sizes = [0, 1, 2].map(|k| {
        let axis = DVec3::new(axes[(0, k)], axes[(1, k)], axes[(2, k)]);
        let span = points
            .iter()
            .map(|&x| (x - mean).dot(axis))
            .fold((0.0_f64, 0.0_f64), |(l, h), v| (l.min(v), h.max(v)));
        span.1 - span.0
    });
    sizes.sort_by(|a, b| b.total_cmp(a));
    sizes
}

/// A body has an axis where it spreads so many times as far along it as across.
const LONGER: f64 = 1.25;

/// The unit direction along which points spread most; `None` where they spread about as far along another.
pub(super) fn principal_axis(points: &[DVec3]) -> Option<DVec3> {
    let eigen = SymmetricEigen::new(scattered(points).1);
    let most = eigen.eigenvalues.imax();
    let others = (0..3)
        .filter(|&k| k != most)
        .map(|k| eigen.eigenvalues[k].max(0.0).sqrt());
    let across = others.fold(0.0, f64::max);
    let axis = eigen.eigenvectors.column(most);
    let is_long = eigen.eigenvalues[most].sqrt() > LONGER * across;
    is_long.then(|| DVec3::new(axis[0], axis[1], axis[2]))
}

/// Mean and scatter matrix.
fn scattered(points: &[DVec3]) -> (DVec3, Matrix3<f64>) {
    let mean = points.iter().sum::<DVec3>() / points.len().max(1) as f64;
    let mut scatter = Matrix3::<f64>::zeros();
    for &x in points {
        let d = nalgebra::Vector3::from((x - mean).to_array());
        scatter += d * d.transpose();
    }
    (mean, scatter)
}

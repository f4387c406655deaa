//! Sizes, surface area and volume of a connected component.

use glam::{DVec2, DVec3};
use nalgebra::{Matrix3, SymmetricEigen};
use rayon::prelude::*;

use super::enclosed_volume::{solid_volume, voxel_volume};
use super::hull::hull_volume;
use super::point_sets::PointGrid;
use super::trait_table::Dimension::{Area, Length, Volume};
use super::trait_table::Trait;
use ostra_core::job::{Progress, Stopped};

/// Returns area, volumes, and sizes along the world axes and the principal axes.
///
/// `spacing` is that of the points.
pub(super) fn extent_traits(points: &[DVec3], area: f64, spacing: f64) -> Vec<Trait> {
    let count = points.len();
    let found =
        |name, value, dimension, definition| Trait::new(name, value, dimension, definition, count);
    let mut traits = vec![
        found(
            "area",
            area,
            Area,
            "area of the surface that the points cover, one side of a thin sheet",
        ),
        found(
            "hull_volume",
            hull_volume(points),
            Volume,
            "volume of the convex hull of the points",
        ),
        found(
            "voxel_volume",
            voxel_volume(points, spacing),
            Volume,
            "voxels that the points enclose, and half of those that hold points; edge 3 spacings; \
             with gaps this is little more than the surface itself",
        ),
    ];
    if let Some(volume) = solid_volume(points, spacing) {
        traits.push(found(
            "volume",
            volume,
            Volume,
            "volume of the solid that the surface encloses; gaps up to 12 spacings are closed",
        ));
    }
    for (name, size) in ["size_long", "size_middle", "size_short"]
        .into_iter()
        .zip(principal_sizes(points))
    {
        let definition = "size of the box along the principal axes of the points, longest first";
        traits.push(found(name, size, Length, definition));
    }
    for (name, size) in ["box_x", "box_y", "box_z"]
        .into_iter()
        .zip(box_sizes(points).to_array())
    {
        traits.push(found(
            name,
            size,
            Length,
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

/// Returns the extents along the principal axes, longest first.
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

/// Minimum ratio of the spread along an axis to the spread across it for a body to have an axis.
const LONGER: f64 = 1.25;

/// Returns the unit direction of the largest spread of the points.
///
/// Returns `None` if the spread along another direction is about as large.
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

/// Returns the mean and the scatter matrix.
fn scattered(points: &[DVec3]) -> (DVec3, Matrix3<f64>) {
    let mean = points.iter().sum::<DVec3>() / points.len().max(1) as f64;
    let mut scatter = Matrix3::<f64>::zeros();
    for &x in points {
        let d = nalgebra::Vector3::from((x - mean).to_array());
        scatter += d * d.transpose();
    }
    (mean, scatter)
}

/// Maximum distance of a cell corner from its point, in spacings.
///
/// It is large enough that cells meet inside a surface.
const CELL_REACH: f64 = 1.6;
/// Distance of the cell edge beyond a border point, in spacings.
///
/// It is half of the gap to the true border.
const BORDER: f64 = 0.30;
/// Radius of the neighbourhood that shapes a cell, in spacings.
const NEIGHBOURHOOD: f64 = 3.2;

/// Returns each point's share of the surface area; a thin sheet counts once.
///
/// The share is the area of the point's Voronoi cell in its tangent plane, cut off at the border of
/// the surface. `spacing` is the median distance to the nearest neighbour; if it is 0, all areas
/// are 0.
pub(super) fn surface_areas(
    points: &[DVec3],
    spacing: f64,
    progress: &Progress,
) -> Result<Vec<f64>, Stopped> {
    if spacing <= 0.0 {
        return Ok(vec![0.0; points.len()]);
    }
    let grid = PointGrid::new(points, NEIGHBOURHOOD * spacing);
    points
        .par_iter()
        .map(|&x| {
            progress
                .check()
                .map(|()| cell_area(points, &grid, x, spacing))
        })
        .collect()
}

fn cell_area(points: &[DVec3], grid: &PointGrid<'_>, x: DVec3, spacing: f64) -> f64 {
    let offsets: Vec<DVec3> = grid
        .within(x, NEIGHBOURHOOD * spacing)
        .map(|k| points[k] - x)
        .filter(|o| *o != DVec3::ZERO)
        .collect();
    if offsets.len() < 3 {
        return 0.0;
    }
    let (u, v) = tangent_plane(&offsets);
    let mut flat: Vec<DVec2> = offsets
        .iter()
        .map(|o| DVec2::new(o.dot(u), o.dot(v)))
        .collect();
    flat.sort_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
    let reach = CELL_REACH * spacing;
    let mut cell: Vec<DVec2> = (0..12)
        .map(|k| reach * DVec2::from_angle(std::f64::consts::TAU * f64::from(k) / 12.0))
        .collect();
    let widest = |cell: &[DVec2]| {
        cell.iter()
            .map(|corner| corner.length())
            .fold(0.0, f64::max)
    };
    for &neighbour in flat
        .iter()
        .filter(|n| n.length_squared() > 1e-6 * spacing * spacing)
    {
        if 0.5 * neighbour.length() > widest(&cell) {
            break;
        }
        clip(&mut cell, neighbour.normalize(), 0.5 * neighbour.length());
    }
    if widest(&cell) > 0.95 * reach {
        let inward = flat.iter().sum::<DVec2>();
        clip(&mut cell, -inward.normalize_or_zero(), BORDER * spacing);
    }
    let twice: f64 = (0..cell.len())
        .map(|k| cell[k].perp_dot(cell[(k + 1) % cell.len()]))
        .sum();
    0.5 * twice
}

/// Returns two orthonormal directions in the tangent plane of a point.
///
/// The plane is fitted to the point (at the origin) and its neighbours.
fn tangent_plane(offsets: &[DVec3]) -> (DVec3, DVec3) {
    let mean = offsets.iter().sum::<DVec3>() / (offsets.len() + 1) as f64;
    let mut scatter = Matrix3::<f64>::zeros();
    for offset in offsets.iter().copied().chain([DVec3::ZERO]) {
        let d = nalgebra::Vector3::from((offset - mean).to_array());
        scatter += d * d.transpose();
    }
    let eigen = SymmetricEigen::new(scatter);
    let least = eigen.eigenvalues.imin();
    let normal = eigen.eigenvectors.column(least);
    DVec3::new(normal[0], normal[1], normal[2])
        .normalize_or(DVec3::Z)
        .any_orthonormal_pair()
}

/// Clips a convex polygon to `direction · x ≤ limit`.
///
/// The algorithm is that of Sutherland, Hodgman, "Reentrant polygon clipping", Communications of
/// the ACM 1974.
fn clip(polygon: &mut Vec<DVec2>, direction: DVec2, limit: f64) {
    let height = |x: DVec2| direction.dot(x) - limit;
    if polygon.iter().all(|&x| height(x) <= 0.0) {
        return;
    }
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    for k in 0..polygon.len() {
        let (a, b) = (polygon[k], polygon[(k + 1) % polygon.len()]);
        let (ha, hb) = (height(a), height(b));
        if ha <= 0.0 {
            kept.push(a);
        }
        if (ha <= 0.0) != (hb <= 0.0) {
            kept.push(a.lerp(b, ha / (ha - hb)));
        }
    }
    *polygon = kept;
}

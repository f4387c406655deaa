use glam::{DVec2, DVec3};
use nalgebra::{Matrix3, SymmetricEigen};
use rayon::prelude::*;

use super::grid::Grid;
use ostra_core::job::{Progress, Stopped};

/// A cell reaches at most this far from its point, in spacings: far enough that cells meet inside a surface.
const CELL_REACH: f64 = 1.6;
/// At the border a cell ends this far beyond its point, in spacings: half of what is missing to the true border.
const BORDER: f64 = 0.30;
/// Neighbours that shape a cell, in spacings.
const NEIGHBOURHOOD: f64 = 3.2;

/// Each point's share of the area of the surface that the points lie on, once for a thin sheet: its Voronoi cell in its
/// tangent plane, cut off at the surface's border. `spacing` is the median distance to the nearest neighbour; 0 gives 0.
pub(super) fn surface_areas(
    points: &[DVec3],
    spacing: f64,
    progress: &Progress,
) -> Result<Vec<f64>, Stopped> {
    if spacing <= 0.0 {
        return Ok(vec![0.0; points.len()]);
    }
    let grid = Grid::new(points, NEIGHBOURHOOD * spacing);
    points
        .par_iter()
        .map(|&x| {
            progress
                .check()
                .map(|()| cell_area(points, &grid, x, spacing))
        })
        .collect()
}

fn cell_area(points: &[DVec3], grid: &Grid<'_>, x: DVec3, spacing: f64) -> f64 {
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

/// Two orthonormal directions in the plane that fits a point (at the origin) and its neighbours.
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

/// Keeps the part of a convex polygon where `direction · x ≤ limit` (Sutherland, Hodgman, "Reentrant polygon
/// clipping", Communications of the ACM 1974).
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

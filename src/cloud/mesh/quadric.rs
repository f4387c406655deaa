//! Error quadrics, and the mesh edges that constrain them.

use std::ops::{Add, AddAssign};

use glam::{DMat3, DVec3};

use super::welded::Welded;

/// Weighted sum of squared distances from planes, as a function of a point: `p·A·p + 2·b·p + c`.
///
/// See Garland & Heckbert, "Surface simplification using quadric error metrics", SIGGRAPH 1997.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Quadric {
    /// xx, yy, zz of the symmetric A; `mixed` holds xy, yz, zx.
    own: DVec3,
    mixed: DVec3,
    linear: DVec3,
    constant: f64,
}

impl Quadric {
    /// Returns the quadric of the plane through `point` with the unit normal `normal`.
    fn of_plane(point: DVec3, normal: DVec3, weight: f64) -> Self {
        let offset = -normal.dot(point);
        let turned = DVec3::new(normal.y, normal.z, normal.x);
        Self {
            own: weight * normal * normal,
            mixed: weight * normal * turned,
            linear: weight * offset * normal,
            constant: weight * offset * offset,
        }
    }

    /// Returns the sum at a point, at least 0.
    pub(super) fn at(&self, point: DVec3) -> f64 {
        let turned = DVec3::new(point.y, point.z, point.x);
        let square = self.own.dot(point * point) + 2.0 * self.mixed.dot(point * turned);
        (square + 2.0 * self.linear.dot(point) + self.constant).max(0.0)
    }

    /// Returns the minimum of the sum, or `None` if the planes do not determine it well.
    pub(super) fn lowest(&self) -> Option<DVec3> {
        /// Minimum determinant, as a share of the largest one of a matrix with the same trace.
        const WELL_FIXED: f64 = 1e-4;
        let Self { own, mixed, .. } = *self;
        let matrix = DMat3::from_cols(
            DVec3::new(own.x, mixed.x, mixed.z),
            DVec3::new(mixed.x, own.y, mixed.y),
            DVec3::new(mixed.z, mixed.y, own.z),
        );
        let mean = own.element_sum() / 3.0;
        (matrix.determinant() > WELL_FIXED * mean.powi(3)).then(|| matrix.inverse() * -self.linear)
    }
}

impl Add for Quadric {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            own: self.own + other.own,
            mixed: self.mixed + other.mixed,
            linear: self.linear + other.linear,
            constant: self.constant + other.constant,
        }
    }
}

impl AddAssign for Quadric {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

/// How far a vertex may move.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Freedom {
    /// Freely: the vertex is inside the surface of one label.
    Free,
    /// Along the label border or open border that it lies on.
    Border,
    /// Not at all: borders meet or end there, or more than two triangles share one of its edges.
    Fixed,
}

/// Constraints on vertices that follow from the edges of a mesh.
pub(super) struct Edges {
    /// Freedom of each vertex.
    pub(super) freedom: Vec<Freedom>,
    /// Quadric of each vertex: the planes of its triangles, and perpendicular planes at borders.
    pub(super) quadrics: Vec<Quadric>,
}

impl Edges {
    pub(super) fn of(mesh: &Welded) -> Self {
        let mut sides: Vec<([u32; 2], u32)> = Vec::with_capacity(mesh.triangles.len() * 3);
        for (at, &[a, b, c]) in mesh.triangles.iter().enumerate() {
            sides.extend([[a, b], [b, c], [c, a]].map(|[a, b]| ([a.min(b), a.max(b)], at as u32)));
        }
        sides.sort_unstable();
        let mut quadrics = plane_quadrics(mesh);
        let mut borders = vec![0u32; mesh.positions.len()];
        let mut fixed = vec![false; mesh.positions.len()];
        for same in sides.chunk_by(|one, other| one.0 == other.0) {
            let pair = same[0].0;
            let labels = || {
                same.iter()
                    .map(|&(_, triangle)| mesh.labels[triangle as usize])
            };
            if same.len() == 2 && labels().next() == labels().next_back() {
                continue;
            }
            for vertex in pair.map(|vertex| vertex as usize) {
                borders[vertex] += 1;
                fixed[vertex] |= same.len() > 2;
            }
            for &(_, triangle) in same {
                let standing = standing_quadric(mesh, pair, triangle as usize);
                pair.iter()
                    .for_each(|&vertex| quadrics[vertex as usize] += standing);
            }
        }
        let freedom = |(&borders, &fixed): (&u32, &bool)| match borders {
            0 => Freedom::Free,
            2 if !fixed => Freedom::Border,
            _ => Freedom::Fixed,
        };
        let freedom = borders.iter().zip(&fixed).map(freedom).collect();
        Self { freedom, quadrics }
    }
}

fn plane_quadrics(mesh: &Welded) -> Vec<Quadric> {
    let mut quadrics = vec![Quadric::default(); mesh.positions.len()];
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|vertex| mesh.positions[vertex as usize]);
        let cross = (b - a).cross(c - a);
        let plane = Quadric::of_plane(a, cross.normalize_or_zero(), cross.length() / 2.0);
        triangle
            .iter()
            .for_each(|&vertex| quadrics[vertex as usize] += plane);
    }
    quadrics
}

/// Returns the quadric of the plane through a border edge perpendicular to its triangle.
///
/// It preserves the course of the border.
fn standing_quadric(mesh: &Welded, [from, to]: [u32; 2], triangle: usize) -> Quadric {
    /// Weight relative to the planes of triangles, which are weighted by area.
    const WEIGHT: f64 = 4.0;
    let [a, b, c] = mesh.triangles[triangle].map(|vertex| mesh.positions[vertex as usize]);
    let start = mesh.positions[from as usize];
    let along = mesh.positions[to as usize] - start;
    let normal = along.cross((b - a).cross(c - a)).normalize_or_zero();
    Quadric::of_plane(start, normal, WEIGHT * along.length_squared())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn minimum_of_three_planes_is_their_intersection() {
        let corner = DVec3::new(0.3, -2.0, 5.0);
        let normals = [
            DVec3::X,
            DVec3::new(0.6, 0.8, 0.0),
            DVec3::new(0.0, 0.6, 0.8),
        ];
        let sum = normals
            .iter()
            .map(|&normal| Quadric::of_plane(corner, normal, 2.0))
            .reduce(Add::add)
            .unwrap();
        assert!(sum.lowest().unwrap().abs_diff_eq(corner, 1e-9));
        assert!(sum.at(corner) < 1e-9);
        let off = DVec3::new(0.1, 0.2, -0.3);
        let squares: f64 = normals
            .iter()
            .map(|normal| 2.0 * normal.dot(off).powi(2))
            .sum();
        assert!((sum.at(corner + off) - squares).abs() < 1e-9);
        assert_eq!(
            Quadric::of_plane(corner, DVec3::Y, 1.0).lowest(),
            None,
            "one plane fixes no point"
        );
    }
}

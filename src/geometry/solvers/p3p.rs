use glam::{DMat3, DQuat, DVec2, DVec3};

use super::real_roots::real_roots;
use crate::Pose;

/// Number of Newton steps on the three distances.
const POLISH_STEPS: usize = 3;

/// Returns up to four poses `camera_from_world` that map three world points onto three rays.
///
/// The points are in front of the camera. The distances are the intersections of two conics, found
/// by a degenerate conic of their pencil, which is two lines (M. Persson, K. Nordberg, *Lambda
/// Twist: An Accurate Fast Robust Perspective Three Point (P3P) Solver*, ECCV 2018; Y. Ding, J.
/// Yang, V. Larsson, C. Olsson, K. Åström, *Revisiting the P3P Problem*, CVPR 2023). Returns none
/// for collinear points.
#[must_use]
pub fn p3p(rays: &[DVec2; 3], points: &[DVec3; 3]) -> Vec<Pose> {
    let directions = rays.map(|ray| ray.extend(1.0).normalize());
    let triangle = Triangle::new(&directions, points);
    let mut found = Vec::with_capacity(4);
    let Some(inverse) =
        side_frame(points[0] - points[1], points[0] - points[2]).map(|frame| frame.inverse())
    else {
        return found;
    };
    for distances in triangle.distances() {
        let [a, b, c] = [0, 1, 2].map(|i| distances[i] * directions[i]);
        let Some(frame) = side_frame(a - b, a - c) else {
            continue;
        };
        let rotation = DQuat::from_mat3(&(frame * inverse)).normalize();
        let translation = a - rotation * points[0];
        if rotation.is_finite() && translation.is_finite() {
            found.push(Pose {
                rotation,
                translation,
            });
        }
    }
    found
}

/// Returns two sides of a triangle and their cross product; `None` if it has no area.
fn side_frame(u: DVec3, v: DVec3) -> Option<DMat3> {
    let normal = u.cross(v);
    let enough = normal.length() > 1e-10 * u.length() * v.length();
    enough.then(|| DMat3::from_cols(u, v, normal))
}

/// Squared sides 12, 13, 23 of the triangle, and the cosines between the rays to its corners.
struct Triangle {
    sides: DVec3,
    cosines: DVec3,
}

impl Triangle {
    fn new(directions: &[DVec3; 3], [p, q, r]: &[DVec3; 3]) -> Self {
        let [a, b, c] = *directions;
        Self {
            sides: DVec3::new(
                p.distance_squared(*q),
                p.distance_squared(*r),
                q.distance_squared(*r),
            ),
            cosines: DVec3::new(a.dot(b), a.dot(c), b.dot(c)),
        }
    }

    /// Returns the distances of the three points along their rays, all above 0.
    fn distances(&self) -> Vec<DVec3> {
        let (a, b) = (self.sides, self.cosines);
        // λᵀ first λ = 0 compares side 12 with side 23, λᵀ second λ = 0 side 13 with side 23.
        let first = symmetric([a.z, a.z - a.x, -a.x], [-a.z * b.x, 0.0, a.x * b.z]);
        let second = symmetric([a.z, -a.y, a.z - a.y], [0.0, -a.z * b.y, a.y * b.z]);
        let mixed = |m: DMat3, n: DMat3| trace_product(adjugate(m), n);
        let pencil = [
            first.determinant(),
            mixed(first, second),
            mixed(second, first),
            second.determinant(),
        ];
        let mut found = Vec::with_capacity(4);
        let Some(&share) = real_roots(&pencil).first() else {
            return found;
        };
        let other = if share.abs() < 1.0 { second } else { first };
        for line in line_pair(first + share * second).into_iter().flatten() {
            for direction in meet(line, other) {
                found.extend(
                    self.scaled(direction)
                        .map(|distances| self.polished(distances)),
                );
            }
        }
        found.retain(|distances| distances.min_element() > 0.0 && distances.is_finite());
        found
    }

    /// Returns the squared sides for given distances.
    fn sides_of(&self, d: DVec3) -> DVec3 {
        let b = self.cosines;
        DVec3::new(
            d.x * d.x + d.y * d.y - 2.0 * b.x * d.x * d.y,
            d.x * d.x + d.z * d.z - 2.0 * b.y * d.x * d.z,
            d.y * d.y + d.z * d.z - 2.0 * b.z * d.y * d.z,
        )
    }

    /// Scales a direction so that the triangle has its size.
    fn scaled(&self, direction: DVec3) -> Option<DVec3> {
        let size = self.sides_of(direction).element_sum();
        let scale = (self.sides.element_sum() / size).sqrt();
        (scale.is_finite() && direction.min_element() > 0.0).then(|| scale * direction)
    }

    fn polished(&self, mut d: DVec3) -> DVec3 {
        let b = self.cosines;
        for _ in 0..POLISH_STEPS {
            let miss = self.sides_of(d) - self.sides;
            let jacobian = 2.0
                * DMat3::from_cols(
                    DVec3::new(d.x - b.x * d.y, d.x - b.y * d.z, 0.0),
                    DVec3::new(d.y - b.x * d.x, 0.0, d.y - b.z * d.z),
                    DVec3::new(0.0, d.z - b.y * d.x, d.z - b.z * d.y),
                );
            let next = d - jacobian.inverse() * miss;
            let better =
                (self.sides_of(next) - self.sides).length_squared() < miss.length_squared();
            if !better {
                break;
            }
            d = next;
        }
        d
    }
}

/// Returns a symmetric matrix from its diagonal and its entries 12, 13, 23.
fn symmetric(d: [f64; 3], o: [f64; 3]) -> DMat3 {
    DMat3::from_cols_array(&[d[0], o[0], o[1], o[0], d[1], o[2], o[1], o[2], d[2]])
}

/// Returns the adjugate of a symmetric matrix.
fn adjugate(m: DMat3) -> DMat3 {
    DMat3::from_cols(
        m.y_axis.cross(m.z_axis),
        m.z_axis.cross(m.x_axis),
        m.x_axis.cross(m.y_axis),
    )
}

fn trace_product(m: DMat3, n: DMat3) -> f64 {
    m.x_axis.dot(n.x_axis) + m.y_axis.dot(n.y_axis) + m.z_axis.dot(n.z_axis)
}

/// Splits a degenerate conic into its two lines; `None` if they are not real.
///
/// J. Richter-Gebert, *Perspectives on Projective Geometry*, 2011, 11.1.
fn line_pair(conic: DMat3) -> Option<[DVec3; 2]> {
    let adjugate = adjugate(conic);
    let (at, value) = (0..3)
        .map(|i| (i, adjugate.col(i)[i]))
        .max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))?;
    if value >= 0.0 {
        return None;
    }
    let p = adjugate.col(at) / (-value).sqrt();
    let turned = DMat3::from_cols_array(&[0.0, p.z, -p.y, -p.z, 0.0, p.x, p.y, -p.x, 0.0]);
    let split = conic + turned;
    let (row, column) = (0..9)
        .map(|i| (i % 3, i / 3))
        .max_by(|&(r, c), &(s, d)| split.col(c)[r].abs().total_cmp(&split.col(d)[s].abs()))?;
    Some([split.row(row), split.col(column)])
}

/// Returns the directions in which a line of the pencil intersects a conic.
fn meet(line: DVec3, conic: DMat3) -> impl Iterator<Item = DVec3> {
    let size = line.abs();
    // Two directions on the line; the equation is solved for the largest coefficient.
    let (u, v) = if size.x >= size.y && size.x >= size.z {
        (
            DVec3::new(-line.y / line.x, 1.0, 0.0),
            DVec3::new(-line.z / line.x, 0.0, 1.0),
        )
    } else if size.y >= size.z {
        (
            DVec3::new(1.0, -line.x / line.y, 0.0),
            DVec3::new(0.0, -line.z / line.y, 1.0),
        )
    } else {
        (
            DVec3::new(1.0, 0.0, -line.x / line.z),
            DVec3::new(0.0, 1.0, -line.y / line.z),
        )
    };
    let (square, half, constant) = (u.dot(conic * u), u.dot(conic * v), v.dot(conic * v));
    // Two nearly equal roots may become complex by rounding.
    let under = half * half - square * constant;
    let root = if under < 0.0 && -under < 1e-12 * half * half {
        0.0
    } else {
        under.sqrt()
    };
    let sum = -(half + root.copysign(half));
    [sum / square, constant / sum]
        .into_iter()
        .filter(|ratio| ratio.is_finite())
        .map(move |ratio| ratio * u + v)
}

use std::ops::{Add, AddAssign};

use glam::{DMat3, DVec3};

/// Weighed sum of squared distances from planes, as a function of the point (Garland & Heckbert, "Surface simplification
/// using quadric error metrics", SIGGRAPH 1997): `p·A·p + 2·b·p + c`.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Quadric {
    /// xx, yy, zz, then xy, yz, zx of the symmetric A.
    own: DVec3,
    mixed: DVec3,
    linear: DVec3,
    constant: f64,
}

impl Quadric {
    /// Of the plane through `point` with the unit normal `normal`.
    pub(super) fn of_plane(point: DVec3, normal: DVec3, weight: f64) -> Self {
        let offset = -normal.dot(point);
        let turned = DVec3::new(normal.y, normal.z, normal.x);
        Self {
            own: weight * normal * normal,
            mixed: weight * normal * turned,
            linear: weight * offset * normal,
            constant: weight * offset * offset,
        }
    }

    /// The sum at a point, not below 0.
    pub(super) fn at(&self, point: DVec3) -> f64 {
        let turned = DVec3::new(point.y, point.z, point.x);
        let square = self.own.dot(point * point) + 2.0 * self.mixed.dot(point * turned);
        (square + 2.0 * self.linear.dot(point) + self.constant).max(0.0)
    }

    /// Where the sum is least; `None` where the planes do not fix a point well.
    pub(super) fn lowest(&self) -> Option<DVec3> {
        /// Least determinant as a share of the largest that a matrix of the same trace can have.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_planes_meet_in_the_lowest_point() {
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

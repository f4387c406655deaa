use glam::{DMat3, DVec2};

use super::null_space::{epipolar_equation, from_rows, null_space};
use super::real_roots::real_roots;

/// Returns up to three fundamental matrices `F` with `x2ᵀ F x1 = 0` for seven pairs `[x1, x2]`.
///
/// Each has `det F = 0` and Frobenius norm 1 (R. Hartley, A. Zisserman, *Multiple View Geometry in
/// Computer Vision*, 2004, 11.1.2). Returns none if the pairs do not restrict `F` to a pencil.
#[must_use]
pub fn seven_point(pairs: &[[DVec2; 2]; 7]) -> Vec<DMat3> {
    let Some(basis) = null_space::<7, 2>(pairs.map(epipolar_equation)) else {
        return Vec::new();
    };
    let [a, b] = basis.map(|entries| from_rows(&entries));
    // det(a z + b) is a cubic; its inner coefficients are determinants of one matrix with columns
    // of the other.
    let mixed = |m: DMat3, n: DMat3| {
        m.x_axis.cross(m.y_axis).dot(n.z_axis)
            + m.y_axis.cross(m.z_axis).dot(n.x_axis)
            + m.z_axis.cross(m.x_axis).dot(n.y_axis)
    };
    let roots = real_roots(&[b.determinant(), mixed(b, a), mixed(a, b), a.determinant()]);
    roots
        .into_iter()
        .map(|z| (a * z + b) * (1.0 / z.hypot(1.0)))
        .collect()
}

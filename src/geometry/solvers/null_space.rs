use glam::{DMat3, DVec2};

/// Returns the equation `x2ᵀ M x1 = 0` of a pair of rays, in the nine entries of `M` row by row.
pub(super) fn epipolar_equation([x1, x2]: [DVec2; 2]) -> [f64; 9] {
    [
        x2.x * x1.x,
        x2.x * x1.y,
        x2.x,
        x2.y * x1.x,
        x2.y * x1.y,
        x2.y,
        x1.x,
        x1.y,
        1.0,
    ]
}

/// Returns a matrix from its nine entries, row by row.
pub(super) fn from_rows(entries: &[f64; 9]) -> DMat3 {
    DMat3::from_cols_array(entries).transpose()
}

/// Relative length below which the independent part of an equation counts as rounding.
const NEW_SHARE: f64 = 1e-12;

/// Returns an orthonormal basis of the null space of `ROWS` equations, with `FREE = 9 − ROWS`.
///
/// Uses Householder reflections. Returns `None` if the equations are linearly dependent or not
/// finite.
pub(super) fn null_space<const ROWS: usize, const FREE: usize>(
    mut rows: [[f64; 9]; ROWS],
) -> Option<[[f64; 9]; FREE]> {
    const { assert!(ROWS + FREE == 9) };
    let mut mirrors = [[0.0; 9]; ROWS];
    for k in 0..ROWS {
        let whole = dot(&rows[k], &rows[k]);
        let mut mirror = rows[k];
        mirror[..k].fill(0.0);
        let length = dot(&mirror, &mirror).sqrt();
        if length.is_nan() || length <= NEW_SHARE * whole.sqrt() {
            return None;
        }
        mirror[k] += length.copysign(mirror[k]);
        let scale = (2.0 / dot(&mirror, &mirror)).sqrt();
        mirror.iter_mut().for_each(|v| *v *= scale);
        rows[k + 1..]
            .iter_mut()
            .for_each(|row| reflect(row, &mirror));
        mirrors[k] = mirror;
    }
    Some(std::array::from_fn(|free| {
        let mut basis = [0.0; 9];
        basis[ROWS + free] = 1.0;
        mirrors
            .iter()
            .rev()
            .for_each(|mirror| reflect(&mut basis, mirror));
        basis
    }))
}

fn reflect(row: &mut [f64; 9], mirror: &[f64; 9]) {
    let along = dot(row, mirror);
    row.iter_mut()
        .zip(mirror)
        .for_each(|(r, m)| *r -= along * m);
}

fn dot(a: &[f64; 9], b: &[f64; 9]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

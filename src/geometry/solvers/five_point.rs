//! Five-point solver for essential matrices.
//!
//! The unknowns are the three coordinates in a four-dimensional null space, subject to ten cubic
//! equations.

use glam::{DMat3, DVec2, DVec3};
use nalgebra::{Matrix3, Vector3};
use wide::f64x4;

use super::null_space::{epipolar_equation, from_rows, null_space};
use super::real_roots::real_roots;

/// Returns up to ten essential matrices `E` with `x2ᵀ E x1 = 0` for five pairs of rays.
///
/// Pairs are `[x1, x2]` (D. Nistér, *An Efficient Solution to the Five-Point Relative Pose
/// Problem*, PAMI 2004). The matrices have Frobenius norm 1. Returns none if the five pairs do not
/// determine them, as for duplicate rays.
#[must_use]
pub fn five_point(pairs: &[[DVec2; 2]; 5]) -> Vec<DMat3> {
    let Some(basis) = null_space::<5, 4>(pairs.map(epipolar_equation)) else {
        return Vec::new();
    };
    let Some(reduced) = eliminate(essential_constraints(&basis)) else {
        return Vec::new();
    };
    let rows = [0, 2, 4].map(|first| InZ::from_pair(&reduced[first], &reduced[first + 1]));
    let roots = real_roots(&determinant(&rows)).into_iter();
    let basis = basis.map(|entries| from_rows(&entries));
    roots
        .filter_map(|z| polished(&basis, solve_at(&rows, z)?))
        .collect()
}

/// Eliminates the first ten monomials by Gauss–Jordan with row pivots.
///
/// Returns the rows that then begin with x²z, x², y²z, y², xyz, xy, from the eleventh monomial on.
fn eliminate(mut equations: [[f64; 20]; 10]) -> Option<[[f64; 10]; 6]> {
    for column in 0..10 {
        let pivot = (column..10).max_by(|&a, &b| {
            equations[a][column]
                .abs()
                .total_cmp(&equations[b][column].abs())
        })?;
        equations.swap(column, pivot);
        let lead = equations[column][column];
        if lead.is_nan() || lead.abs() < f64::MIN_POSITIVE {
            return None;
        }
        let mut row = equations[column];
        row.iter_mut().for_each(|v| *v /= lead);
        equations[column] = row;
        // The first four rows are not needed afterwards.
        for other in (4..10)
            .chain(column + 1..4)
            .filter(|&other| other != column)
        {
            let share = equations[other][column];
            equations[other]
                .iter_mut()
                .zip(&row)
                .for_each(|(v, r)| *v -= share * r);
        }
    }
    Some(std::array::from_fn(|i| {
        std::array::from_fn(|k| equations[i + 4][k + 10])
    }))
}

/// The equation `x(z) · x + y(z) · y + one(z) = 0`; coefficients start with the lowest power.
struct InZ {
    x: [f64; 4],
    y: [f64; 4],
    one: [f64; 5],
}

impl InZ {
    /// Returns the first row minus z times the second: the leading monomials cancel.
    fn from_pair(a: &[f64; 10], b: &[f64; 10]) -> Self {
        let cubic = |first: usize| {
            [
                a[first + 2],
                a[first + 1] - b[first + 2],
                a[first] - b[first + 1],
                -b[first],
            ]
        };
        let one = [a[9], a[8] - b[9], a[7] - b[8], a[6] - b[7], -b[6]];
        Self {
            x: cubic(0),
            y: cubic(3),
            one,
        }
    }

    fn at(&self, z: f64) -> DVec3 {
        let value =
            |coefficients: &[f64]| coefficients.iter().rev().fold(0.0, |sum, c| sum * z + c);
        DVec3::new(value(&self.x), value(&self.y), value(&self.one))
    }
}

/// Returns the determinant of the three equations, of degree 10 in z.
fn determinant(rows: &[InZ; 3]) -> [f64; 11] {
    let mut sum = [0.0; 11];
    for [i, j, k] in [[0, 1, 2], [1, 2, 0], [2, 0, 1]] {
        let mut minor = [0.0; 7];
        for (a, (xi, yi)) in rows[i].x.iter().zip(&rows[i].y).enumerate() {
            for (b, (xj, yj)) in rows[j].x.iter().zip(&rows[j].y).enumerate() {
                minor[a + b] += xi * yj - yi * xj;
            }
        }
        for (a, m) in minor.iter().enumerate() {
            rows[k]
                .one
                .iter()
                .enumerate()
                .for_each(|(b, one)| sum[a + b] += m * one);
        }
    }
    sum
}

/// Returns the coordinates in the basis for a root z, normalised to 1.
///
/// (x, y, 1) is orthogonal to all three equations.
fn solve_at(rows: &[InZ; 3], z: f64) -> Option<[f64; 4]> {
    let [a, b, c] = [0, 1, 2].map(|i| rows[i].at(z));
    let candidates = [a.cross(b), b.cross(c), c.cross(a)];
    let best = candidates
        .into_iter()
        .max_by(|u, v| u.z.abs().total_cmp(&v.z.abs()))?;
    let shares = [best.x / best.z, best.y / best.z, z, 1.0];
    let norm = shares.iter().map(|v| v * v).sum::<f64>().sqrt();
    norm.is_finite().then(|| shares.map(|v| v / norm))
}

/// Number of Gauss–Newton steps on the constraints.
const POLISH_STEPS: usize = 4;
/// Squared norm of the constraints that is due to rounding.
const EXACT: f64 = 1e-24;
/// Squared norm of the constraints above which a root is rejected.
const NO_ROOT: f64 = 1e-14;

/// Refines a solution on the constraints.
///
/// Elimination loses digits if pivots are small; a few steps on the constraints themselves restore
/// them.
fn polished(basis: &[DMat3; 4], mut shares: [f64; 4]) -> Option<DMat3> {
    let matrix = |shares: [f64; 4]| (0..4).fold(DMat3::ZERO, |sum, k| sum + basis[k] * shares[k]);
    for _ in 0..POLISH_STEPS {
        let e = matrix(shares);
        let miss = constraint(e);
        if inner(miss, miss) < EXACT {
            break;
        }
        // The largest coordinate is kept, since the scale of E is arbitrary.
        let fixed = (0..4).max_by(|&i, &k| shares[i].abs().total_cmp(&shares[k].abs()))?;
        let free = [1, 2, 3].map(|k| (fixed + k) % 4);
        let slopes = free.map(|k| constraint_slope(e, basis[k]));
        let normal = Matrix3::from_fn(|i, k| inner(slopes[i], slopes[k]));
        let towards = Vector3::from_fn(|i, _| inner(slopes[i], miss));
        let step = normal.cholesky()?.solve(&towards);
        (0..3).for_each(|i| shares[free[i]] -= step[i]);
    }
    let e = matrix(shares);
    let norm = inner(e, e).sqrt();
    let e = e * (1.0 / norm);
    let miss = constraint(e);
    (inner(miss, miss) < NO_ROOT).then_some(e)
}

/// Returns `2 E Eᵀ E − trace(E Eᵀ) E`, which is zero exactly for essential matrices.
///
/// `det E = 0` follows from it.
fn constraint(e: DMat3) -> DMat3 {
    2.0 * (e * (e.transpose() * e)) - inner(e, e) * e
}

/// Returns the derivative of [`constraint`] in the direction `d`.
fn constraint_slope(e: DMat3, d: DMat3) -> DMat3 {
    let turned = e.transpose();
    2.0 * (d * (turned * e) + e * (d.transpose() * e) + e * (turned * d))
        - 2.0 * inner(e, d) * e
        - inner(e, e) * d
}

fn inner(a: DMat3, b: DMat3) -> f64 {
    a.x_axis.dot(b.x_axis) + a.y_axis.dot(b.y_axis) + a.z_axis.dot(b.z_axis)
}

/// Coefficients of x, y, z, 1; lanes are the three columns of a row of the matrix.
type Linear = [f64x4; 4];
/// Coefficients of x², y², z², xy, xz, yz, x, y, z, 1.
type Quadratic = [f64x4; 10];
/// Coefficients of cubic monomials in the order of D. Nistér.
///
/// The order is x³, y³, x²y, xy², x²z, x², y²z, y², xyz, xy, then xz², xz, x, yz², yz, y, z³, z²,
/// z, 1.
type Cubic = [f64x4; 20];

/// Returns the equations `2 E Eᵀ E = trace(E Eᵀ) E` and `det E = 0`.
///
/// `E = x B₀ + y B₁ + z B₂ + B₃`. The result is ten rows of the coefficients of [`Cubic`]'s
/// monomials.
pub(super) fn essential_constraints(basis: &[[f64; 9]; 4]) -> [[f64; 20]; 10] {
    let row = |i: usize| -> Linear {
        std::array::from_fn(|k| lanes(basis[k][3 * i], basis[k][3 * i + 1], basis[k][3 * i + 2]))
    };
    let e = [row(0), row(1), row(2)];
    let gram =
        |i: usize, k: usize| square(&e[i], &e[k]).map(|lanes| f64x4::splat(lanes.reduce_add()));
    let (aa, bb, cc, ab, ac, bc) = (
        gram(0, 0),
        gram(1, 1),
        gram(2, 2),
        gram(0, 1),
        gram(0, 2),
        gram(1, 2),
    );
    // E Eᵀ minus trace / 2 on the diagonal: half the difference to the other two entries.
    let half = |plus: &Quadratic, minus: [&Quadratic; 2]| -> Quadratic {
        std::array::from_fn(|m| (plus[m] - minus[0][m] - minus[1][m]) * 0.5)
    };
    let diagonal = [
        half(&aa, [&bb, &cc]),
        half(&bb, [&aa, &cc]),
        half(&cc, [&aa, &bb]),
    ];
    let rows = [
        [&diagonal[0], &ab, &ac],
        [&ab, &diagonal[1], &bc],
        [&ac, &bc, &diagonal[2]],
    ];
    let mut equations = [[0.0; 20]; 10];
    for (i, factors) in rows.iter().enumerate() {
        let mut sum = [f64x4::ZERO; 20];
        (0..3).for_each(|k| add_product(&mut sum, factors[k], &e[k]));
        for (m, lanes) in sum.iter().enumerate() {
            let lanes = lanes.to_array();
            (0..3).for_each(|j| equations[3 * i + j][m] = lanes[j]);
        }
    }
    let mut determinant = [f64x4::ZERO; 20];
    add_product(&mut determinant, &cross(&e[1], &e[2]), &e[0]);
    equations[9] = determinant.map(f64x4::reduce_add);
    equations
}

fn lanes(a: f64, b: f64, c: f64) -> f64x4 {
    f64x4::from([a, b, c, 0.0])
}

fn square(a: &Linear, b: &Linear) -> Quadratic {
    let mixed = |i: usize, k: usize| a[i] * b[k] + a[k] * b[i];
    [
        a[0] * b[0],
        a[1] * b[1],
        a[2] * b[2],
        mixed(0, 1),
        mixed(0, 2),
        mixed(1, 2),
        mixed(0, 3),
        mixed(1, 3),
        mixed(2, 3),
        a[3] * b[3],
    ]
}

/// Returns the cross product over the lanes.
fn cross(a: &Linear, b: &Linear) -> Quadratic {
    let turned = |row: &Linear, by: usize| -> Linear {
        row.map(|v| {
            let v = v.to_array();
            lanes(v[by % 3], v[(by + 1) % 3], v[(by + 2) % 3])
        })
    };
    let plus = square(&turned(a, 1), &turned(b, 2));
    let minus = square(&turned(a, 2), &turned(b, 1));
    std::array::from_fn(|m| plus[m] - minus[m])
}

#[inline]
fn add_product(sum: &mut Cubic, q: &Quadratic, l: &Linear) {
    sum[0] += q[0] * l[0];
    sum[1] += q[1] * l[1];
    sum[2] += q[0] * l[1] + q[3] * l[0];
    sum[3] += q[1] * l[0] + q[3] * l[1];
    sum[4] += q[0] * l[2] + q[4] * l[0];
    sum[5] += q[0] * l[3] + q[6] * l[0];
    sum[6] += q[1] * l[2] + q[5] * l[1];
    sum[7] += q[1] * l[3] + q[7] * l[1];
    sum[8] += q[3] * l[2] + q[4] * l[1] + q[5] * l[0];
    sum[9] += q[3] * l[3] + q[6] * l[1] + q[7] * l[0];
    sum[10] += q[2] * l[0] + q[4] * l[2];
    sum[11] += q[4] * l[3] + q[6] * l[2] + q[8] * l[0];
    sum[12] += q[6] * l[3] + q[9] * l[0];
    sum[13] += q[2] * l[1] + q[5] * l[2];
    sum[14] += q[5] * l[3] + q[7] * l[2] + q[8] * l[1];
    sum[15] += q[7] * l[3] + q[9] * l[1];
    sum[16] += q[2] * l[2];
    sum[17] += q[2] * l[3] + q[8] * l[2];
    sum[18] += q[8] * l[3] + q[9] * l[2];
    sum[19] += q[9] * l[3];
}

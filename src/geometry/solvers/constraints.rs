//! The ten cubic equations of an essential matrix in the three unknowns of a four-dimensional null space.

use wide::f64x4;

/// Coefficients of x, y, z, 1; lanes are the three columns of a row of the matrix.
type Linear = [f64x4; 4];
/// Coefficients of x², y², z², xy, xz, yz, x, y, z, 1.
type Quadratic = [f64x4; 10];
/// Coefficients in the order of D. Nistér: x³, y³, x²y, xy², x²z, x², y²z, y², xyz, xy, then xz², xz, x, yz², yz, y, z³,
/// z², z, 1.
type Cubic = [f64x4; 20];

/// `2 E Eᵀ E = trace(E Eᵀ) E` and `det E = 0` for `E = x B₀ + y B₁ + z B₂ + B₃`; ten rows of the coefficients of
/// [`Cubic`]'s monomials.
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
    // E Eᵀ − trace / 2 on the diagonal: half of what the other two leave out.
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

/// Cross product over the lanes.
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

use pulp::{Arch, Simd, WithSimd};

use super::skyline::{
    Block6, Column6, Skyline, backward, dot, factor_block, forward, subtract_product,
};

/// Maximum number of steps.
const MAX_STEPS: usize = 500;
/// Relative gain at which the iteration stops.
///
/// It stops if the gain of a step, times the number of steps so far, falls below this share of the
/// total gain (S. Nash, A. Sofer, *Assessing a search direction within a truncated-Newton method*,
/// Operations Research Letters 1990).
const TOLERANCE: f64 = 0.02;

/// Solves `matrix · x = right` by preconditioned conjugate gradients.
///
/// The accuracy is about what a step of Levenberg–Marquardt needs (S. Agarwal, N. Snavely, S.
/// Seitz, R. Szeliski, *Bundle Adjustment in the Large*, ECCV 2010). The preconditioner is block
/// Jacobi. Returns `None` if the matrix is not positive definite.
pub fn conjugate_gradients(matrix: &Skyline, right: &[Column6]) -> Option<Vec<Column6>> {
    Arch::new().dispatch(Solve { matrix, right })
}

struct Solve<'a> {
    matrix: &'a Skyline,
    right: &'a [Column6],
}

impl WithSimd for Solve<'_> {
    type Output = Option<Vec<Column6>>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Self::Output {
        let Self { matrix, right } = self;
        let filled = filled(matrix);
        let preconditioner = preconditioner(matrix)?;
        let mut x = vec![[0.0; 6]; right.len()];
        let mut residual = right.to_vec();
        let mut improved = precondition(&preconditioner, &residual);
        let mut direction = improved.clone();
        let mut size = inner(&residual, &improved);
        let mut gain = 0.0;
        for step in 1..=MAX_STEPS {
            let product = multiply(matrix, &filled, &direction);
            let curvature = inner(&direction, &product);
            if size <= 0.0 || curvature.is_nan() || curvature <= 0.0 {
                return (size == 0.0).then_some(x);
            }
            let length = size / curvature;
            advance(&mut x, length, &direction);
            advance(&mut residual, -length, &product);
            // The quadratic model decreases by half of length · size with each step.
            let more = 0.5 * length * size;
            gain += more;
            if step as f64 * more <= TOLERANCE * gain {
                break;
            }
            improved = precondition(&preconditioner, &residual);
            let before = std::mem::replace(&mut size, inner(&residual, &improved));
            for (direction, improved) in direction.iter_mut().zip(&improved) {
                for (value, improved) in direction.iter_mut().zip(improved) {
                    *value = improved + size / before * *value;
                }
            }
        }
        Some(x)
    }
}

/// Non-zero blocks of each row, without the diagonal.
fn filled(matrix: &Skyline) -> Vec<Vec<u32>> {
    let is_filled = |block: &Block6| block.as_flattened().iter().any(|&v| v != 0.0);
    let of_row = |blocks: &[Block6]| {
        (0..blocks.len() as u32 - 1)
            .filter(|&j| is_filled(&blocks[j as usize]))
            .collect()
    };
    matrix.rows.iter().map(|row| of_row(&row.blocks)).collect()
}

fn preconditioner(matrix: &Skyline) -> Option<Vec<Block6>> {
    let factored = |block: &Block6| {
        let mut factor = *block;
        factor_block(&mut factor, block).then_some(factor)
    };
    matrix
        .rows
        .iter()
        .map(|row| row.blocks.last().and_then(factored))
        .collect()
}

#[inline(always)]
fn precondition(preconditioner: &[Block6], residual: &[Column6]) -> Vec<Column6> {
    let mut out = residual.to_vec();
    for (x, factor) in out.iter_mut().zip(preconditioner) {
        forward(factor, x);
        backward(factor, x);
    }
    out
}

#[inline(always)]
fn multiply(matrix: &Skyline, filled: &[Vec<u32>], x: &[Column6]) -> Vec<Column6> {
    // The sign is flipped at the end, because block products can only be subtracted.
    let mut out = vec![[0.0; 6]; x.len()];
    for (i, (row, filled)) in matrix.rows.iter().zip(filled).enumerate() {
        let mut own = [0.0; 6];
        for &j in filled {
            let (j, block) = (row.first + j as usize, &row.blocks[j as usize]);
            subtract_product(&mut own, block, &x[j]);
            for (value, column) in out[j].iter_mut().zip(block) {
                *value -= dot(column, &x[i]);
            }
        }
        subtract_product(&mut own, &row.blocks[row.blocks.len() - 1], &x[i]);
        advance(&mut out[i..=i], 1.0, &[own]);
    }
    for value in out.as_flattened_mut() {
        *value = -*value;
    }
    out
}

#[inline(always)]
fn inner(a: &[Column6], b: &[Column6]) -> f64 {
    a.iter().zip(b).map(|(a, b)| dot(a, b)).sum()
}

#[inline(always)]
fn advance(x: &mut [Column6], length: f64, direction: &[Column6]) {
    for (x, direction) in x
        .as_flattened_mut()
        .iter_mut()
        .zip(direction.as_flattened())
    {
        *x += length * direction;
    }
}

/// Maximum number of multiplications for a factorisation.
///
/// This is about 400 poses that are all connected with each other. Larger systems are solved by
/// conjugate gradients.
const DIRECT_WORK: f64 = 2.5e9;

/// Solves `matrix · x = right`, to the accuracy that a step of Levenberg–Marquardt needs.
///
/// Returns `None` if the matrix is not positive definite or x is not finite. Overwrites the matrix.
#[must_use]
pub fn solve(matrix: &mut Skyline, right: &[Column6]) -> Option<Vec<Column6>> {
    if matrix.work() > DIRECT_WORK {
        return conjugate_gradients(matrix, right);
    }
    if !matrix.factor() {
        return None;
    }
    let mut step = right.to_vec();
    matrix.solve(&mut step);
    step.iter().flatten().all(|v| v.is_finite()).then_some(step)
}

use super::conjugate::conjugate_gradients;
use super::kernel::Column;
use super::skyline::Skyline;

/// Multiplications up to which the equations are factored (about 400 poses that are all tied to each other); beyond, they
/// are solved by conjugate gradients.
const DIRECT_WORK: f64 = 2.5e9;

/// Solves `matrix · x = right`, to the accuracy that a step of Levenberg–Marquardt needs; `None` where the matrix is not
/// positive definite or x not finite. The matrix is lost.
#[must_use]
pub fn solve(matrix: &mut Skyline, right: &[Column]) -> Option<Vec<Column>> {
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

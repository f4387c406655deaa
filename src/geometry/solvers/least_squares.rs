/// A robust least-squares problem with `N` parameters, at one state.
pub(crate) trait Problem<const N: usize>: Sized {
    /// Returns the cost, the normal matrix `Jᵀ W J` and the gradient `Jᵀ W r`.
    ///
    /// Only the lower half of the matrix is read.
    fn linearise(&self) -> Linearised<N>;
    /// Returns the problem after a step.
    fn moved(&self, step: &[f64; N]) -> Self;
}

/// A linearised problem: sums of the normal equations.
pub(crate) struct Linearised<const N: usize> {
    pub cost: f64,
    pub normal: [[f64; N]; N],
    pub gradient: [f64; N],
}

impl<const N: usize> Linearised<N> {
    /// Returns empty sums.
    pub const ZERO: Self = Self {
        cost: 0.0,
        normal: [[0.0; N]; N],
        gradient: [0.0; N],
    };

    /// Adds one residual with its derivative and weight.
    #[inline(always)]
    pub fn add(&mut self, residual: f64, slope: &[f64; N], weight: f64) {
        for i in 0..N {
            let weighted = weight * slope[i];
            self.gradient[i] += weighted * residual;
            for (sum, other) in self.normal[i].iter_mut().zip(slope) {
                *sum += weighted * other;
            }
        }
    }
}

/// Initial damping, as a share of the diagonal.
const FIRST_DAMPING: f64 = 1e-4;
/// Relative decrease of the cost below which the iteration stops.
const SMALL_GAIN: f64 = 1e-5;

/// Minimises the cost from `start` in at most `max_steps` steps of Levenberg–Marquardt.
///
/// D. Marquardt, *An Algorithm for Least-Squares Estimation of Nonlinear Parameters*, SIAM 1963,
/// after K. Levenberg. The result is never worse than `start`.
pub(crate) fn minimise<const N: usize, P: Problem<N>>(start: P, max_steps: usize) -> P {
    let (mut state, mut damping) = (start, FIRST_DAMPING);
    let mut here = state.linearise();
    for _ in 0..max_steps {
        let mut damped = here.normal;
        (0..N).for_each(|i| damped[i][i] += damping * damped[i][i] + f64::MIN_POSITIVE);
        let Some(step) = solve_positive(damped, here.gradient.map(|g| -g)) else {
            break;
        };
        let trial = state.moved(&step);
        let there = trial.linearise();
        if there.cost < here.cost {
            let gain = here.cost - there.cost;
            let last = gain < SMALL_GAIN * here.cost;
            (state, here) = (trial, there);
            damping = (damping * 0.1).max(1e-12);
            if last {
                break;
            }
        } else if damping > 1e3 {
            break;
        } else {
            damping *= 10.0;
        }
    }
    state
}

/// Solves `a x = b` for a symmetric positive definite `a` by Cholesky decomposition.
///
/// Only the lower half of `a` is read. Returns `None` if `a` is not positive definite.
fn solve_positive<const N: usize>(mut a: [[f64; N]; N], mut b: [f64; N]) -> Option<[f64; N]> {
    for i in 0..N {
        for k in 0..=i {
            let sum: f64 = (0..k).map(|m| a[i][m] * a[k][m]).sum();
            let rest = a[i][k] - sum;
            if i > k {
                a[i][k] = rest / a[k][k];
            } else if rest > 0.0 && rest.is_finite() {
                a[i][i] = rest.sqrt();
            } else {
                return None;
            }
        }
        let known: f64 = (0..i).map(|m| a[i][m] * b[m]).sum();
        b[i] = (b[i] - known) / a[i][i];
    }
    for i in (0..N).rev() {
        let known: f64 = (i + 1..N).map(|m| a[m][i] * b[m]).sum();
        b[i] = (b[i] - known) / a[i][i];
    }
    b.iter().all(|v| v.is_finite()).then_some(b)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_positive_definite_systems_are_solved() {
        let x = solve_positive(
            [[4.0, 0.0, 0.0], [1.0, 3.0, 0.0], [0.5, -1.0, 2.0]],
            [7.5, 4.0, 4.5],
        )
        .unwrap();
        // The full matrix: [4 1 .5; 1 3 −1; .5 −1 2].
        let back = [
            4.0 * x[0] + x[1] + 0.5 * x[2],
            x[0] + 3.0 * x[1] - x[2],
            0.5 * x[0] - x[1] + 2.0 * x[2],
        ];
        assert!(
            back.iter()
                .zip([7.5, 4.0, 4.5])
                .all(|(b, t)| (b - t).abs() < 1e-12),
            "{back:?}"
        );
        assert_eq!(solve_positive([[1.0, 0.0], [2.0, 1.0]], [1.0, 1.0]), None);
        assert_eq!(solve_positive([[f64::NAN]], [1.0]), None);
    }

    /// Rosenbrock's function.
    ///
    /// H. H. Rosenbrock, *An Automatic Method for Finding the Greatest or Least Value of a
    /// Function*, 1960.
    struct Valley([f64; 2]);

    impl Problem<2> for Valley {
        fn linearise(&self) -> Linearised<2> {
            let [x, y] = self.0;
            let rows = [
                (1.0 - x, [-1.0, 0.0]),
                (10.0 * (y - x * x), [-20.0 * x, 10.0]),
            ];
            let mut sum = Linearised::ZERO;
            for (residual, slope) in rows {
                sum.cost += residual * residual;
                sum.add(residual, &slope, 1.0);
            }
            sum
        }

        fn moved(&self, step: &[f64; 2]) -> Self {
            Self([self.0[0] + step[0], self.0[1] + step[1]])
        }
    }

    #[test]
    fn rosenbrock_function_is_minimised() {
        let end = minimise(Valley([-1.2, 1.0]), 100).0;
        assert!(end.iter().all(|v| (v - 1.0).abs() < 1e-6), "{end:?}");
    }
}

use glam::{DMat3, DQuat, DVec3};
use nalgebra::Matrix3;
use pulp::{Simd, WithSimd};

use super::matched::{MatchLanes, Matched};
use crate::Pose;
use crate::epipolar::{cross_matrix, essential_from_pose, poses_from_essential};
use crate::ransac::LANES;
use crate::solvers::{Linearised, Problem, minimise};

/// Maximum number of Levenberg–Marquardt steps of one refinement.
const STEPS: usize = 6;

/// A matrix between rays, parametrised by as many numbers as it has degrees of freedom.
trait Chart<const N: usize>: Copy {
    fn matrix(&self) -> DMat3;
    fn slopes(&self) -> [DMat3; N];
    fn moved(&self, step: &[f64; N]) -> Self;
}

/// Refines an essential matrix over its inliers.
pub(super) fn refine_essential(matched: &Matched, start: DMat3) -> Option<DMat3> {
    // All four poses give the same matrix.
    let chart = poses_from_essential(start)?[0];
    Some(essential_from_pose(
        &minimise(
            SampsonFit {
                matched,
                limit: matched.limit,
                chart,
            },
            STEPS,
        )
        .chart,
    ))
}

/// Refines a fundamental matrix (between rays) over the matches near it.
///
/// Matches within `reach` times the threshold are used.
pub(super) fn refine_fundamental(matched: &Matched, start: DMat3, reach: f64) -> Option<DMat3> {
    let limit = reach * reach * matched.limit;
    Some(
        minimise(
            SampsonFit {
                matched,
                limit,
                chart: Rank2::of(start)?,
            },
            STEPS,
        )
        .chart
        .matrix(),
    )
}

struct SampsonFit<'a, C> {
    matched: &'a Matched,
    limit: f64,
    chart: C,
}

impl<const N: usize, C: Chart<N>> Problem<N> for SampsonFit<'_, C> {
    fn linearise(&self) -> Linearised<N> {
        let sampson = Sampson {
            matched: self.matched,
            matrix: self.chart.matrix(),
            limit: self.limit,
        };
        let by_entries = self.matched.arch.dispatch(sampson);
        let slopes = self.chart.slopes().map(|slope| slope.to_cols_array());
        let mut sum = Linearised {
            cost: by_entries.cost,
            ..Linearised::ZERO
        };
        for i in 0..N {
            let towards: [f64; 9] = std::array::from_fn(|r| {
                (0..9).map(|c| by_entries.normal[r][c] * slopes[i][c]).sum()
            });
            sum.gradient[i] = (0..9).map(|r| by_entries.gradient[r] * slopes[i][r]).sum();
            for (entry, slope) in sum.normal[i].iter_mut().zip(&slopes) {
                *entry = (0..9).map(|r| towards[r] * slope[r]).sum();
            }
        }
        sum
    }

    fn moved(&self, step: &[f64; N]) -> Self {
        Self {
            chart: self.chart.moved(step),
            ..*self
        }
    }
}

/// Sampson error of all matches under Tukey's biweight, by the nine entries of the matrix.
///
/// Entries are column by column. Errors beyond the limit have no influence.
struct Sampson<'a> {
    matched: &'a Matched,
    matrix: DMat3,
    limit: f64,
}

impl WithSimd for Sampson<'_> {
    type Output = Linearised<9>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Linearised<9> {
        let mut sums = Sums {
            cost: [0.0; LANES],
            gradient: [[0.0; LANES]; 9],
            normal: [[0.0; LANES]; 45],
        };
        for block in &self.matched.blocks {
            sums.add(&self.matrix, self.limit, block);
        }
        sums.over_lanes()
    }
}

/// [`Linearised`] in eight lanes; of the normal matrix only the lower half, row by row.
struct Sums {
    cost: [f64; LANES],
    gradient: [[f64; LANES]; 9],
    normal: [[f64; LANES]; 45],
}

impl Sums {
    #[inline(always)]
    fn add(&mut self, m: &DMat3, limit: f64, b: &MatchLanes) {
        let (mut slopes, mut residual, mut weight) =
            ([[0.0; LANES]; 9], [0.0; LANES], [0.0; LANES]);
        for lane in 0..LANES {
            let (one, rest) = slope(
                m,
                limit,
                [b.x1[lane], b.y1[lane], b.x2[lane], b.y2[lane]],
                [b.pixel1[lane], b.pixel2[lane]],
            );
            let counts = rest > 0.0;
            let rest = if counts { rest } else { 0.0 };
            self.cost[lane] += limit * (1.0 - rest * rest * rest);
            weight[lane] = rest * rest;
            residual[lane] = if counts { one[9] } else { 0.0 };
            for i in 0..9 {
                slopes[i][lane] = if counts { one[i] } else { 0.0 };
            }
        }
        let mut at = 0;
        for i in 0..9 {
            let mut weighted = slopes[i];
            for lane in 0..LANES {
                weighted[lane] *= weight[lane];
                self.gradient[i][lane] += weighted[lane] * residual[lane];
            }
            for other in &slopes[..=i] {
                for lane in 0..LANES {
                    self.normal[at][lane] += weighted[lane] * other[lane];
                }
                at += 1;
            }
        }
    }

    fn over_lanes(&self) -> Linearised<9> {
        let total = |lanes: &[f64; LANES]| lanes.iter().sum::<f64>();
        let mut sum = Linearised {
            cost: total(&self.cost),
            ..Linearised::ZERO
        };
        let mut at = 0;
        for i in 0..9 {
            sum.gradient[i] = total(&self.gradient[i]);
            for k in 0..=i {
                (sum.normal[i][k], sum.normal[k][i]) =
                    (total(&self.normal[at]), total(&self.normal[at]));
                at += 1;
            }
        }
        sum
    }
}

/// Returns the derivatives of one match's error, the error, and the weight term.
///
/// The derivatives are by the nine entries. The weight term is 1 minus the squared error over the
/// limit.
#[inline(always)]
fn slope(
    m: &DMat3,
    limit: f64,
    [x1, y1, x2, y2]: [f64; 4],
    [p1, p2]: [f64; 2],
) -> ([f64; 10], f64) {
    let (a, b, c) = (m.x_axis, m.y_axis, m.z_axis);
    let line = [
        a.x * x1 + b.x * y1 + c.x,
        a.y * x1 + b.y * y1 + c.y,
        a.z * x1 + b.z * y1 + c.z,
    ];
    let back = [a.x * x2 + a.y * y2 + a.z, b.x * x2 + b.y * y2 + b.z];
    let miss = x2 * line[0] + y2 * line[1] + line[2];
    let spread =
        p2 * (line[0] * line[0] + line[1] * line[1]) + p1 * (back[0] * back[0] + back[1] * back[1]);
    // d(miss / √spread) = (dmiss − miss / spread · dspread / 2) / √spread
    let scale = spread.sqrt().recip();
    let share = miss / spread;
    let (l0, l1) = (scale * share * p2 * line[0], scale * share * p2 * line[1]);
    let (u, v) = (
        scale * (x1 - share * p1 * back[0]),
        scale * (y1 - share * p1 * back[1]),
    );
    let slopes = [
        x2 * u - l0 * x1,
        y2 * u - l1 * x1,
        u,
        x2 * v - l0 * y1,
        y2 * v - l1 * y1,
        v,
        x2 * scale - l0,
        y2 * scale - l1,
        scale,
        miss * scale,
    ];
    (slopes, 1.0 - miss * share / limit)
}

const AXES: [DVec3; 3] = [DVec3::X, DVec3::Y, DVec3::Z];

impl Chart<5> for Pose {
    fn matrix(&self) -> DMat3 {
        essential_from_pose(self)
    }

    fn slopes(&self) -> [DMat3; 5] {
        let r = DMat3::from_quat(self.rotation);
        let t = cross_matrix(self.translation);
        let [a, b, c] = AXES.map(|axis| t * cross_matrix(axis) * r);
        let (u, v) = self.translation.any_orthonormal_pair();
        [a, b, c, cross_matrix(u) * r, cross_matrix(v) * r]
    }

    fn moved(&self, step: &[f64; 5]) -> Self {
        let turn = DQuat::from_scaled_axis(DVec3::new(step[0], step[1], step[2]));
        let (u, v) = self.translation.any_orthonormal_pair();
        Self {
            rotation: (turn * self.rotation).normalize(),
            translation: (self.translation + step[3] * u + step[4] * v).normalize(),
        }
    }
}

/// The parametrisation `U diag(1, ratio, 0) Vᵀ`.
///
/// A. Bartoli, P. Sturm, *Nonlinear Estimation of the Fundamental Matrix with Minimal Parameters*,
/// PAMI 2004.
#[derive(Clone, Copy)]
struct Rank2 {
    u: DMat3,
    v: DMat3,
    ratio: f64,
}

impl Rank2 {
    fn of(m: DMat3) -> Option<Self> {
        let entries = m.to_cols_array();
        if !entries.iter().all(|v| v.is_finite()) {
            return None;
        }
        let svd = Matrix3::from_column_slice(&entries).svd(true, true);
        let (u, vt, s) = (svd.u?, svd.v_t?, svd.singular_values);
        let (most, least) = (s.imax(), s.imin());
        let middle = 3_usize.checked_sub(most + least)?;
        let order = [most, middle, least];
        let pick = |columns: &DMat3| {
            DMat3::from_cols(
                columns.col(order[0]),
                columns.col(order[1]),
                columns.col(order[2]),
            )
        };
        let u = pick(&DMat3::from_cols_slice(u.as_slice()));
        let v = pick(&DMat3::from_cols_slice(vt.as_slice()).transpose());
        (most != least).then(|| Self {
            u,
            v,
            ratio: s[middle] / s[most],
        })
    }

    fn with(&self, shares: [f64; 2]) -> DMat3 {
        self.u * DMat3::from_diagonal(DVec3::new(shares[0], shares[1], 0.0)) * self.v.transpose()
    }
}

impl Chart<7> for Rank2 {
    fn matrix(&self) -> DMat3 {
        self.with([1.0, self.ratio])
    }

    fn slopes(&self) -> [DMat3; 7] {
        let f = self.matrix();
        let [a, b, c] = AXES.map(|axis| cross_matrix(axis) * f);
        let [d, e, g] = AXES.map(|axis| -(f * cross_matrix(axis)));
        [a, b, c, d, e, g, self.with([0.0, 1.0])]
    }

    fn moved(&self, step: &[f64; 7]) -> Self {
        let turn = |x, y, z| DMat3::from_quat(DQuat::from_scaled_axis(DVec3::new(x, y, z)));
        Self {
            u: turn(step[0], step[1], step[2]) * self.u,
            v: turn(step[3], step[4], step[5]) * self.v,
            ratio: self.ratio + step[6],
        }
    }
}

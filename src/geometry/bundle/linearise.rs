use glam::{DVec2, DVec3};
use pulp::{Simd, WithSimd};

use super::layout::{Factors, Layout, PointBlock};
use super::state::CameraState;
use crate::blocks::Column6;

/// Derivatives of one piece's observations, ready to be added to the reduced matrix.
///
/// The buffers are reused.
#[derive(Debug, Clone, Default)]
pub(super) struct Derivatives {
    /// Derivatives by poses and intrinsics; residuals on the right-hand side.
    pub by_observation: Factors<2>,
    /// `W L⁻ᵀ` with `L Lᵀ` the points' own block: subtracted when the points are eliminated.
    pub by_point: Factors<3>,
    /// Derivatives of the observations of one point.
    rows: Vec<[DVec3; 2]>,
}

/// Computes the derivatives of all observations of a piece.
pub(super) struct Linearise<'a> {
    pub point_block: &'a PointBlock,
    pub layout: &'a Layout,
    pub state: &'a CameraState,
    pub damping: f64,
    pub out: &'a mut Derivatives,
}

impl WithSimd for Linearise<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self {
            point_block,
            layout,
            state,
            damping,
            out,
        } = self;
        out.by_observation.resize(&point_block.by_observation);
        out.by_point.resize(&point_block.by_point);
        for point in 0..point_block.points.len() {
            let terms = observations(point_block, point, layout, state, out);
            if !layout.fixed_points {
                eliminate(point_block, point, layout, terms.factor(damping), out);
            }
        }
    }
}

/// Computes the derivatives of a point's observations.
#[inline(always)]
fn observations(
    point_block: &PointBlock,
    point: usize,
    layout: &Layout,
    state: &CameraState,
    out: &mut Derivatives,
) -> PointTerms {
    let mut terms = PointTerms::default();
    out.rows.clear();
    for at in point_block.observations_of(point) {
        let observation = &point_block.observations[at];
        let Some(observed) = state.observe(point_block.points[point], observation) else {
            out.rows.push([DVec3::ZERO; 2]);
            out.by_observation
                .leave_out(&point_block.by_observation, at);
            continue;
        };
        terms.add(&observed.by_point, observed.residual);
        out.rows.push(observed.by_point);
        out.by_observation.values[at] = observed.residual.to_array();
        let columns = &mut out.by_observation.columns[point_block.by_observation.entries(at)];
        let poses = usize::from(layout.poses[observation.image as usize].is_some());
        let (pose, intrinsics) = columns.split_at_mut(poses);
        if let [pose] = pose {
            *pose = observed.by_pose();
        }
        if !intrinsics.is_empty() {
            intrinsics.copy_from_slice(&observed.by_intrinsics()[..intrinsics.len()]);
        }
    }
    terms
}

/// Computes the terms that eliminating a point subtracts.
///
/// If its observations do not determine the point, they are ignored.
#[inline(always)]
fn eliminate(
    point_block: &PointBlock,
    point: usize,
    layout: &Layout,
    factor: Option<PointFactor>,
    out: &mut Derivatives,
) {
    let entries = point_block.by_point.entries(point);
    let (by_observation, by_point) = (&mut out.by_observation, &mut out.by_point);
    by_point.leave_out(&point_block.by_point, point);
    let mut next = entries.start;
    let mut value = DVec3::ZERO;
    for (at, rows) in point_block.observations_of(point).zip(&out.rows) {
        let own = point_block.by_observation.entries(at);
        let Some(factor) = &factor else {
            by_observation.leave_out(&point_block.by_observation, at);
            continue;
        };
        let rows = rows.map(|row| factor.forward(row));
        let residual = by_observation.values[at];
        value += rows[0] * residual[0] + rows[1] * residual[1];
        let mut own = own;
        if layout.poses[point_block.observations[at].image as usize].is_some() {
            by_point.columns[next] = through(&by_observation.columns[own.start], &rows);
            next += 1;
            own.start += 1;
        }
        for entry in own {
            let block = point_block.by_observation.blocks[entry];
            let Some(shared) = entries
                .clone()
                .rev()
                .find(|&e| point_block.by_point.blocks[e] == block)
            else {
                continue;
            };
            let more = through(&by_observation.columns[entry], &rows);
            for (column, more) in by_point.columns[shared]
                .as_flattened_mut()
                .iter_mut()
                .zip(more.as_flattened())
            {
                *column += more;
            }
        }
    }
    by_point.values[point] = value.to_array();
}

/// Returns `J_cᵀ (J_p L⁻ᵀ)`.
#[inline(always)]
fn through(columns: &[Column6; 2], rows: &[DVec3; 2]) -> [Column6; 3] {
    std::array::from_fn(|k| {
        std::array::from_fn(|i| columns[0][i] * rows[0][k] + columns[1][i] * rows[1][k])
    })
}

/// Normal equations of one point: `V` (upper triangle: xx xy xz yy yz zz) and the gradient.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PointTerms {
    v: [f64; 6],
    gradient: DVec3,
}

/// Lower triangle `L` of a damped `V = L Lᵀ`, with its diagonal inverted.
#[derive(Debug, Clone, Copy)]
pub(super) struct PointFactor {
    inverse_diagonal: [f64; 3],
    below: [f64; 3],
}

impl PointTerms {
    /// Adds one observation's derivatives and residual.
    ///
    /// If other unknowns have moved, the residual includes their change.
    #[inline(always)]
    pub fn add(&mut self, by_point: &[DVec3; 2], residual: DVec2) {
        for (d, r) in by_point.iter().zip(residual.to_array()) {
            let terms = [
                d.x * d.x,
                d.x * d.y,
                d.x * d.z,
                d.y * d.y,
                d.y * d.z,
                d.z * d.z,
            ];
            for (v, term) in self.v.iter_mut().zip(terms) {
                *v += term;
            }
            self.gradient += *d * r;
        }
    }

    /// Returns the factor; `None` if the observations do not determine the point.
    #[inline(always)]
    pub fn factor(&self, damping: f64) -> Option<PointFactor> {
        let [xx, xy, xz, yy, yz, zz] = self.v;
        let more = 1.0 + damping;
        let a = (xx * more).sqrt();
        let (b, c) = (xy / a, xz / a);
        let d = (yy * more - b * b).sqrt();
        let e = (yz - b * c) / d;
        let f = (zz * more - c * c - e * e).sqrt();
        let inverse_diagonal = [1.0 / a, 1.0 / d, 1.0 / f];
        inverse_diagonal
            .iter()
            .all(|v| v.is_finite())
            .then_some(PointFactor {
                inverse_diagonal,
                below: [b, c, e],
            })
    }

    /// Returns the point's step.
    #[inline(always)]
    pub fn step(&self, factor: &PointFactor) -> DVec3 {
        -factor.backward(factor.forward(self.gradient))
    }

    /// Returns the change of the quadratic model of the cost by the point's step.
    #[inline(always)]
    pub fn change(&self, step: DVec3) -> f64 {
        let [xx, xy, xz, yy, yz, zz] = self.v;
        let v_step = DVec3::new(
            xx * step.x + xy * step.y + xz * step.z,
            xy * step.x + yy * step.y + yz * step.z,
            xz * step.x + yz * step.y + zz * step.z,
        );
        step.dot(self.gradient + 0.5 * v_step)
    }
}

impl PointFactor {
    /// Returns `L⁻¹ v`.
    #[inline(always)]
    pub fn forward(&self, v: DVec3) -> DVec3 {
        let ([a, d, f], [b, c, e]) = (self.inverse_diagonal, self.below);
        let x = v.x * a;
        let y = (v.y - b * x) * d;
        DVec3::new(x, y, (v.z - c * x - e * y) * f)
    }

    /// Returns `L⁻ᵀ v`.
    #[inline(always)]
    fn backward(&self, v: DVec3) -> DVec3 {
        let ([a, d, f], [b, c, e]) = (self.inverse_diagonal, self.below);
        let z = v.z * f;
        let y = (v.y - e * z) * d;
        DVec3::new((v.x - b * y - c * z) * a, y, z)
    }
}

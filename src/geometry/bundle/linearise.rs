use glam::DVec3;
use pulp::{Simd, WithSimd};

use super::arrange::Layout;
use super::groups::Factors;
use super::piece::Piece;
use super::point::{PointFactor, PointTerms};
use super::state::State;
use crate::blocks::Column;

/// The derivatives of one piece's observations, ready to be added to the reduced matrix; kept to be filled again.
#[derive(Debug, Clone, Default)]
pub(super) struct Derivatives {
    /// By poses and intrinsics; residuals on the right.
    pub by_sighting: Factors<2>,
    /// `W L⁻ᵀ` with `L Lᵀ` the points' own block: what eliminating the points takes away.
    pub by_point: Factors<3>,
    /// Of the observations of one point.
    rows: Vec<[DVec3; 2]>,
}

/// Takes the derivatives of all observations of a piece.
pub(super) struct Linearise<'a> {
    pub piece: &'a Piece,
    pub layout: &'a Layout,
    pub state: &'a State,
    pub damping: f64,
    pub out: &'a mut Derivatives,
}

impl WithSimd for Linearise<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self {
            piece,
            layout,
            state,
            damping,
            out,
        } = self;
        out.by_sighting.resize(&piece.by_sighting);
        out.by_point.resize(&piece.by_point);
        for point in 0..piece.points.len() {
            let terms = observations(piece, point, layout, state, out);
            if !layout.fixed_points {
                eliminate(piece, point, layout, terms.factor(damping), out);
            }
        }
    }
}

/// The derivatives of a point's observations.
#[inline(always)]
fn observations(
    piece: &Piece,
    point: usize,
    layout: &Layout,
    state: &State,
    out: &mut Derivatives,
) -> PointTerms {
    let mut terms = PointTerms::default();
    out.rows.clear();
    for at in piece.sightings_of(point) {
        let sighting = &piece.sightings[at];
        let Some(observed) = state.observe(piece.points[point], sighting) else {
            out.rows.push([DVec3::ZERO; 2]);
            out.by_sighting.leave_out(&piece.by_sighting, at);
            continue;
        };
        terms.add(&observed.by_point, observed.residual);
        out.rows.push(observed.by_point);
        out.by_sighting.values[at] = observed.residual.to_array();
        let columns = &mut out.by_sighting.columns[piece.by_sighting.entries(at)];
        let poses = usize::from(layout.poses[sighting.image as usize].is_some());
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

/// What eliminating a point takes away; where its observations do not hold it, they are left out.
#[inline(always)]
fn eliminate(
    piece: &Piece,
    point: usize,
    layout: &Layout,
    factor: Option<PointFactor>,
    out: &mut Derivatives,
) {
    let entries = piece.by_point.entries(point);
    let (by_sighting, by_point) = (&mut out.by_sighting, &mut out.by_point);
    by_point.leave_out(&piece.by_point, point);
    let mut next = entries.start;
    let mut value = DVec3::ZERO;
    for (at, rows) in piece.sightings_of(point).zip(&out.rows) {
        let own = piece.by_sighting.entries(at);
        let Some(factor) = &factor else {
            by_sighting.leave_out(&piece.by_sighting, at);
            continue;
        };
        let rows = rows.map(|row| factor.forward(row));
        let residual = by_sighting.values[at];
        value += rows[0] * residual[0] + rows[1] * residual[1];
        let mut own = own;
        if layout.poses[piece.sightings[at].image as usize].is_some() {
            by_point.columns[next] = through(&by_sighting.columns[own.start], &rows);
            next += 1;
            own.start += 1;
        }
        for entry in own {
            let block = piece.by_sighting.blocks[entry];
            let Some(shared) = entries
                .clone()
                .rev()
                .find(|&e| piece.by_point.blocks[e] == block)
            else {
                continue;
            };
            let more = through(&by_sighting.columns[entry], &rows);
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

/// `J_cᵀ (J_p L⁻ᵀ)`.
#[inline(always)]
fn through(columns: &[Column; 2], rows: &[DVec3; 2]) -> [Column; 3] {
    std::array::from_fn(|k| {
        std::array::from_fn(|i| columns[0][i] * rows[0][k] + columns[1][i] * rows[1][k])
    })
}

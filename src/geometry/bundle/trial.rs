use glam::{DVec2, DVec3};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::arrange::Layout;
use super::piece::Piece;
use super::point::PointTerms;
use super::state::{Observed, State};
use crate::blocks::{Column, dot};

/// A step of all poses and intrinsics, to be tried.
pub(super) struct Trial<'a> {
    pub layout: &'a Layout,
    /// Before the step.
    pub state: &'a State,
    /// After it.
    pub moved: &'a State,
    pub step: &'a [Column],
    pub damping: f64,
}

/// What a step brings.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Outcome {
    /// Half the sum of the loss after the step, in px².
    pub cost: f64,
    /// By how much the linear model lets the cost fall.
    pub predicted: f64,
}

/// Half the sum of the loss over all pieces, in px².
pub(super) fn cost(pieces: &[Piece], state: &State) -> f64 {
    let of = |piece: &Piece| -> f64 {
        (0..piece.points.len())
            .map(|point| cost_at(piece, point, piece.points[point], state))
            .sum()
    };
    let costs: Vec<f64> = pieces.par_iter().map(of).collect();
    costs.iter().sum()
}

impl Trial<'_> {
    /// Moves the points as the step wants it (into [`Piece::tried`]) and evaluates the whole. Sums run in the order of
    /// the pieces.
    pub fn evaluate(&self, pieces: &mut [Piece]) -> Outcome {
        let arch = Arch::new();
        let outcomes: Vec<Outcome> = pieces
            .par_iter_mut()
            .map(|piece| arch.dispatch(TrialOf { trial: self, piece }))
            .collect();
        outcomes
            .iter()
            .fold(Outcome::default(), |sum, outcome| Outcome {
                cost: sum.cost + outcome.cost,
                predicted: sum.predicted + outcome.predicted,
            })
    }

    /// The step of one point that belongs to the step of poses and intrinsics, and by how much the model's cost falls.
    #[inline(always)]
    fn point_step(&self, piece: &Piece, point: usize) -> (DVec3, f64) {
        let mut terms = PointTerms::default();
        let mut change = 0.0;
        for sighting in &piece.sightings[piece.sightings_of(point)] {
            let Some(observed) = self.state.observe(piece.points[point], sighting) else {
                continue;
            };
            let shift = self.shift(&observed, sighting.image);
            terms.add(&observed.by_point, observed.residual + shift);
            change += shift.dot(observed.residual + 0.5 * shift);
        }
        if self.layout.fixed_points {
            return (DVec3::ZERO, -change);
        }
        let Some(factor) = terms.factor(self.damping) else {
            return (DVec3::ZERO, 0.0);
        };
        let step = terms.step(&factor);
        (step, -change - terms.change(step))
    }

    /// By how much the step moves an observation's residual in the linear model.
    #[inline(always)]
    fn shift(&self, observed: &Observed<'_>, image: u32) -> DVec2 {
        let mut shift = DVec2::ZERO;
        if let Some(pose) = self.layout.poses[image as usize] {
            let [x, y] = observed.by_pose();
            shift += DVec2::new(dot(&x, &self.step[pose]), dot(&y, &self.step[pose]));
        }
        let intrinsics = &self.layout.intrinsics[self.state.camera_of(image)];
        if !intrinsics.is_empty() {
            for ([x, y], step) in observed
                .by_intrinsics()
                .iter()
                .zip(&self.step[intrinsics.clone()])
            {
                shift += DVec2::new(dot(x, step), dot(y, step));
            }
        }
        shift
    }
}

struct TrialOf<'a> {
    trial: &'a Trial<'a>,
    piece: &'a mut Piece,
}

impl WithSimd for TrialOf<'_> {
    type Output = Outcome;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Outcome {
        let Self { trial, piece } = self;
        let mut outcome = Outcome::default();
        for point in 0..piece.points.len() {
            let (step, predicted) = trial.point_step(piece, point);
            let tried = piece.points[point] + step;
            piece.tried[point] = tried;
            outcome.predicted += predicted;
            outcome.cost += cost_at(piece, point, tried, trial.moved);
        }
        outcome
    }
}

#[inline(always)]
fn cost_at(piece: &Piece, point: usize, at: DVec3, state: &State) -> f64 {
    let sightings = &piece.sightings[piece.sightings_of(point)];
    sightings
        .iter()
        .map(|sighting| 0.5 * state.cost(at, sighting))
        .sum()
}

use std::ops::ControlFlow;

use super::arrange::{Layout, arrange};
use super::normal::Normal;
use super::options::{BundleOptions, BundleSummary};
use super::piece::Piece;
use super::problem::Bundle;
use super::state::State;
use super::trial::{Outcome, Trial, cost};
use crate::blocks::Column;

/// How far a step may go: damping of the normal equations and how it changes (the rule of K. Madsen, H. Nielsen,
/// O. Tingleff, *Methods for Non-Linear Least Squares Problems*, 2004).
struct Damping {
    value: f64,
    growth: f64,
}

const FIRST_DAMPING: f64 = 1e-4;
const LEAST_DAMPING: f64 = 1e-10;
/// Beyond this no step is worth while.
const MOST_DAMPING: f64 = 1e12;

impl Damping {
    fn accept(&mut self, gain: f64) {
        self.value =
            (self.value * (1.0 - (2.0 * gain - 1.0).powi(3)).max(1.0 / 3.0)).max(LEAST_DAMPING);
        self.growth = 2.0;
    }

    fn refuse(&mut self) {
        self.value *= self.growth;
        self.growth *= 2.0;
    }
}

/// Moves cameras, poses and points until the loss of their reprojection errors is least: Levenberg–Marquardt with
/// iteratively reweighted least squares for the loss. `step(iteration, cost)` is asked before each iteration; `Break`
/// ends it with the best state so far.
///
/// Left out are observations that are not finite, name something that does not exist, or are not seen at the start
/// (behind the camera, beyond a lens that folds back), and points seen from fewer than two images unless points are
/// fixed. What is left without observations stays as it is. One that goes behind its camera on the way counts as an
/// error of a picture's diagonal.
pub fn adjust(
    bundle: &mut Bundle,
    options: &BundleOptions,
    step: &mut dyn FnMut(usize, f64) -> ControlFlow<()>,
) -> BundleSummary {
    let state = State::new(bundle, options);
    let (layout, pieces) = arrange(bundle, options, &state);
    let cost = cost(&pieces, &state);
    let mut search = Search {
        normal: Normal::new(&layout),
        layout,
        pieces,
        state,
        cost,
    };
    let summary = search.run(options, step);
    if summary.final_cost < summary.initial_cost {
        search.store(bundle);
    }
    summary
}

/// The adjustment under way; state and points are always the best so far.
struct Search {
    layout: Layout,
    pieces: Vec<Piece>,
    state: State,
    cost: f64,
    normal: Normal,
}

impl Search {
    fn run(
        &mut self,
        options: &BundleOptions,
        step: &mut dyn FnMut(usize, f64) -> ControlFlow<()>,
    ) -> BundleSummary {
        let mut damping = Damping {
            value: FIRST_DAMPING,
            growth: 2.0,
        };
        let mut summary = BundleSummary {
            iterations: 0,
            initial_cost: self.cost,
            final_cost: self.cost,
            converged: self.pieces.is_empty(),
            stopped: false,
        };
        while !summary.converged && summary.iterations < options.max_iterations {
            if step(summary.iterations, self.cost).is_break() {
                summary.stopped = true;
                break;
            }
            summary.iterations += 1;
            summary.converged = self.iterate(&mut damping, options.function_tolerance);
        }
        summary.final_cost = self.cost;
        summary
    }

    /// One step, taken if it lowers the cost; returns whether nothing is left to be gained.
    fn iterate(&mut self, damping: &mut Damping, tolerance: f64) -> bool {
        self.normal
            .build(&self.pieces, &self.layout, &self.state, damping.value);
        let tried = self
            .normal
            .solve()
            .map(|step| self.attempt(&step, damping.value));
        let Some((moved, outcome)) = tried else {
            damping.refuse();
            return damping.value > MOST_DAMPING;
        };
        let least = tolerance * self.cost;
        if outcome.cost < self.cost {
            let gain = self.cost - outcome.cost;
            damping.accept(gain / outcome.predicted);
            self.accept(moved, outcome.cost);
            return gain <= least;
        }
        damping.refuse();
        outcome.predicted <= least.min(f64::EPSILON * self.cost) || damping.value > MOST_DAMPING
    }

    fn attempt(&mut self, step: &[Column], damping: f64) -> (State, Outcome) {
        let moved = self.state.moved(&self.layout, step);
        let trial = Trial {
            layout: &self.layout,
            state: &self.state,
            moved: &moved,
            step,
            damping,
        };
        let outcome = trial.evaluate(&mut self.pieces);
        (moved, outcome)
    }

    fn accept(&mut self, moved: State, cost: f64) {
        self.state = moved;
        self.cost = cost;
        for piece in &mut self.pieces {
            std::mem::swap(&mut piece.points, &mut piece.tried);
        }
    }

    /// Writes the result back; what did not move keeps its very bits.
    fn store(&self, bundle: &mut Bundle) {
        bundle.cameras.clone_from(&self.state.cameras);
        for (image, pose) in bundle.images.iter_mut().zip(&self.state.poses) {
            image.camera_from_world = *pose;
        }
        for piece in &self.pieces {
            for (&id, &point) in piece.ids.iter().zip(&piece.points) {
                bundle.points[id as usize] = point;
            }
        }
    }
}

use std::ops::ControlFlow;

use glam::{DVec2, DVec3};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::arrange::arrange;
use super::layout::{Layout, PointBlock};
use super::linearise::PointTerms;
use super::normal::Normal;
use super::problem::{Bundle, BundleOptions, BundleSummary};
use super::state::{CameraState, Observed};
use crate::blocks::{Column6, dot};

/// Damping of the normal equations and how it changes.
///
/// The update rule is that of K. Madsen, H. Nielsen, O. Tingleff, *Methods for Non-Linear Least
/// Squares Problems*, 2004.
struct Damping {
    value: f64,
    growth: f64,
}

const FIRST_DAMPING: f64 = 1e-4;
const LEAST_DAMPING: f64 = 1e-10;
/// Maximum damping; beyond it, steps are too small to be useful.
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

/// Minimises the robust reprojection error over cameras, poses and points.
///
/// The method is Levenberg–Marquardt with iteratively reweighted least squares for the loss.
/// `step(iteration, cost)` is called before each iteration; `Break` ends the adjustment with the
/// best state so far.
///
/// Observations are ignored if they are not finite, have invalid indices, or are not visible at the
/// start (behind the camera, or beyond a lens that folds back). Points seen from fewer than two
/// images are ignored unless points are fixed. Anything left without observations keeps its value.
/// An observation that goes behind its camera during the adjustment counts as an error of the
/// image's diagonal.
pub fn adjust(
    bundle: &mut Bundle,
    options: &BundleOptions,
    step: &mut dyn FnMut(usize, f64) -> ControlFlow<()>,
) -> BundleSummary {
    let state = CameraState::new(bundle, options);
    let (layout, point_blocks) = arrange(bundle, options, &state);
    let cost = cost(&point_blocks, &state);
    let mut search = AdjustmentState {
        normal: Normal::new(&layout),
        layout,
        point_blocks,
        state,
        cost,
    };
    let summary = search.run(options, step);
    if summary.final_cost < summary.initial_cost {
        search.store(bundle);
    }
    summary
}

/// An adjustment in progress; state and points are always the best so far.
struct AdjustmentState {
    layout: Layout,
    point_blocks: Vec<PointBlock>,
    state: CameraState,
    cost: f64,
    normal: Normal,
}

impl AdjustmentState {
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
            converged: self.point_blocks.is_empty(),
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

    /// Tries one step and accepts it if it lowers the cost; returns whether it has converged.
    fn iterate(&mut self, damping: &mut Damping, tolerance: f64) -> bool {
        self.normal
            .build(&self.point_blocks, &self.layout, &self.state, damping.value);
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

    fn attempt(&mut self, step: &[Column6], damping: f64) -> (CameraState, StepOutcome) {
        let moved = self.state.moved(&self.layout, step);
        let candidate = CandidateStep {
            layout: &self.layout,
            state: &self.state,
            moved: &moved,
            step,
            damping,
        };
        let outcome = candidate.evaluate(&mut self.point_blocks);
        (moved, outcome)
    }

    fn accept(&mut self, moved: CameraState, cost: f64) {
        self.state = moved;
        self.cost = cost;
        for point_block in &mut self.point_blocks {
            std::mem::swap(&mut point_block.points, &mut point_block.tried);
        }
    }

    /// Writes the result back; values that did not change stay bit-identical.
    fn store(&self, bundle: &mut Bundle) {
        bundle.cameras.clone_from(&self.state.cameras);
        for (image, pose) in bundle.images.iter_mut().zip(&self.state.poses) {
            image.camera_from_world = *pose;
        }
        for point_block in &self.point_blocks {
            for (&id, &point) in point_block.ids.iter().zip(&point_block.points) {
                bundle.points[id as usize] = point;
            }
        }
    }
}

/// A candidate step of all poses and intrinsics.
pub(super) struct CandidateStep<'a> {
    pub layout: &'a Layout,
    /// State before the step.
    pub state: &'a CameraState,
    /// State after the step.
    pub moved: &'a CameraState,
    pub step: &'a [Column6],
    pub damping: f64,
}

/// Effect of a step.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct StepOutcome {
    /// Half the sum of the loss after the step, in px².
    pub cost: f64,
    /// Decrease of the cost predicted by the linear model.
    pub predicted: f64,
}

/// Returns half the sum of the loss over all pieces, in px².
pub(super) fn cost(point_blocks: &[PointBlock], state: &CameraState) -> f64 {
    let of = |point_block: &PointBlock| -> f64 {
        (0..point_block.points.len())
            .map(|point| cost_at(point_block, point, point_block.points[point], state))
            .sum()
    };
    let costs: Vec<f64> = point_blocks.par_iter().map(of).collect();
    costs.iter().sum()
}

impl CandidateStep<'_> {
    /// Moves the points by the step (into [`PointBlock::tried`]) and evaluates the cost.
    ///
    /// Sums are in the order of the pieces.
    pub fn evaluate(&self, point_blocks: &mut [PointBlock]) -> StepOutcome {
        let arch = Arch::new();
        let outcomes: Vec<StepOutcome> = point_blocks
            .par_iter_mut()
            .map(|point_block| {
                arch.dispatch(TrialOf {
                    candidate: self,
                    point_block,
                })
            })
            .collect();
        outcomes
            .iter()
            .fold(StepOutcome::default(), |sum, outcome| StepOutcome {
                cost: sum.cost + outcome.cost,
                predicted: sum.predicted + outcome.predicted,
            })
    }

    /// Returns the step of one point and the predicted decrease.
    ///
    /// The step follows from that of poses and intrinsics.
    #[inline(always)]
    fn point_step(&self, point_block: &PointBlock, point: usize) -> (DVec3, f64) {
        let mut terms = PointTerms::default();
        let mut change = 0.0;
        for observation in &point_block.observations[point_block.observations_of(point)] {
            let Some(observed) = self.state.observe(point_block.points[point], observation) else {
                continue;
            };
            let shift = self.shift(&observed, observation.image);
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

    /// Returns the change of an observation's residual in the linear model.
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
    candidate: &'a CandidateStep<'a>,
    point_block: &'a mut PointBlock,
}

impl WithSimd for TrialOf<'_> {
    type Output = StepOutcome;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> StepOutcome {
        let Self {
            candidate,
            point_block,
        } = self;
        let mut outcome = StepOutcome::default();
        for point in 0..point_block.points.len() {
            let (step, predicted) = candidate.point_step(point_block, point);
            let tried = point_block.points[point] + step;
            point_block.tried[point] = tried;
            outcome.predicted += predicted;
            outcome.cost += cost_at(point_block, point, tried, candidate.moved);
        }
        outcome
    }
}

#[inline(always)]
fn cost_at(point_block: &PointBlock, point: usize, at: DVec3, state: &CameraState) -> f64 {
    let observations = &point_block.observations[point_block.observations_of(point)];
    observations
        .iter()
        .map(|observation| 0.5 * state.cost(at, observation))
        .sum()
}

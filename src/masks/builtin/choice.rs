//! Which candidate a click most likely means.

use super::candidates::Candidate;
use super::situation::Situation;
use super::traits::{TRAITS, Traits};

/// Traits whose squares count too, scaled by [`SQUARE_SCALE`].
const SQUARED: [usize; 5] = [1, 2, 3, 9, 12];
const SQUARE_SCALE: f32 = 0.3;

/// Number of terms of a score.
pub(super) const TERMS: usize = TRAITS + SQUARED.len();

/// The three kinds of clicks, each with weights of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    First,
    Include,
    Exclude,
}

/// Score weights: one row per [`Kind`], one weight per term.
pub(super) type Weights = [[f32; TERMS]; 3];

/// Fitted by `fitting.rs`: one row per [`Kind`], one weight per term.
#[rustfmt::skip]
pub(super) const WEIGHTS: Weights = [
    [-62.4379, -0.0064, -0.0629, 0.7303, -9.0735, 0.0000, -7.3366, 3.9801, 0.1435, 0.0207, -1.0865, 13.7800, -0.0064, 0.0000, 0.0000, -0.0949, -1.6234, -2.4877, 0.0192, -0.3131],
    [-8.3575, -0.2584, -0.9857, 0.3096, -2.0779, 8.5706, -6.0698, 1.1601, 2.0708, 0.0739, -0.2255, 1.4903, -0.1755, -0.2195, -1.2523, -0.0825, -1.1301, -1.2496, 0.0048, 0.0431],
    [-11.3729, -0.1678, -1.5120, 0.1026, -2.4263, 6.1951, 10.8138, 1.9103, 0.6953, 0.0570, -0.2708, 0.8850, -0.2081, -0.1178, -3.7722, -0.0112, -1.6588, -1.5242, 0.0012, 0.0336],
];

/// The kind of the click of a situation.
pub(super) fn kind_of(situation: &Situation<'_>) -> Kind {
    match situation.include {
        true if situation.area == 0.0 => Kind::First,
        true => Kind::Include,
        false => Kind::Exclude,
    }
}

/// Traits and squares, as weighted by a score.
pub(super) fn terms(traits: &Traits) -> [f32; TERMS] {
    std::array::from_fn(|at| match at.checked_sub(TRAITS) {
        None => traits[at],
        Some(square) => SQUARE_SCALE * traits[SQUARED[square]] * traits[SQUARED[square]],
    })
}

/// The candidate with the best score; the first of equals.
pub(super) fn best(weights: &Weights, kind: Kind, candidates: &[Candidate]) -> Option<usize> {
    let weights = &weights[kind as usize];
    let score = |candidate: &Candidate| -> f32 {
        terms(&candidate.traits).iter().zip(weights).map(|(term, weight)| term * weight).sum()
    };
    let scores: Vec<f32> = candidates.iter().map(score).collect();
    (0..scores.len()).rev().max_by(|&a, &b| scores[a].total_cmp(&scores[b]))
}

//! Which candidate a click most likely means.

use super::candidates::{Candidate, Candidates};
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
    [-63.0857, 0.0485, -2.9874, 0.6383, -16.6782, 0.0000, -5.0101, 1.8269, -1.0264, -0.1689, 0.4156, 12.5931, 0.0485, 0.0000, 0.0000, 2.7583, 1.8254, -9.6080, -0.6926, -7.1975, -0.0825, -2.8695, -2.1713, -0.0031, -0.2879],
    [-7.5419, -0.4040, -1.0667, 0.1123, -1.6529, 9.6874, 1.0584, 0.4253, -0.1728, 0.0290, -0.1785, 1.7360, -0.2943, -0.2517, -0.5888, 0.7987, 0.1528, -4.8689, 1.1269, -2.3128, -0.0897, -0.8674, -1.4454, 0.0008, -0.0066],
    [-7.9433, -0.2063, -1.1236, -0.0816, -2.3529, 5.8053, 5.7721, 0.9637, -0.0723, 0.0094, -0.3688, 1.6631, -0.2467, -0.1435, -3.0053, 2.1217, 0.4757, -1.5080, -3.2600, 0.4025, -0.0168, -0.5523, -1.5248, -0.0004, 0.0143],
];

/// How far the scores are trusted, per [`Kind`]: 0 = all candidates alike, large = the best score alone.
const SHARPNESS: [f32; 3] = [0.4, 0.7, 1.0];

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

/// The candidate that, by the chances that the scores give to all, may be expected to share most with what is meant.
pub(super) fn best(weights: &Weights, kind: Kind, candidates: &Candidates) -> Option<usize> {
    let weights = &weights[kind as usize];
    let score = |candidate: &Candidate| -> f32 {
        SHARPNESS[kind as usize]
            * terms(&candidate.traits).iter().zip(weights).map(|(term, weight)| term * weight).sum::<f32>()
    };
    let scores: Vec<f32> = candidates.all.iter().map(score).collect();
    expected_best(&scores, &candidates.shared)
}

/// The index whose mean of `shared`, weighted by softmax of the scores, is largest; the first of equals.
pub(super) fn expected_best(scores: &[f32], shared: &[Vec<f32>]) -> Option<usize> {
    let top = scores.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let chances: Vec<f32> = scores.iter().map(|score| (score - top).exp()).collect();
    let expected: Vec<f32> =
        shared.iter().map(|row| row.iter().zip(&chances).map(|(shared, chance)| shared * chance).sum()).collect();
    (0..expected.len()).rev().max_by(|&a, &b| expected[a].total_cmp(&expected[b]))
}

//! Which candidate a click most likely means.

use super::candidates::{Candidate, Candidates};
use super::situation::Situation;
use super::traits::{TRAITS, Traits};

/// Traits whose squares count too, scaled by [`SQUARE_SCALE`].
const SQUARED: [usize; 5] = [1, 2, 3, 9, 12];
const SQUARE_SCALE: f32 = 0.3;

/// Number of terms of a score.
pub(super) const TERMS: usize = TRAITS + SQUARED.len();

/// The kinds of clicks, each with weights of its own: without depth, then with depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    First,
    Include,
    Exclude,
    DeepFirst,
    DeepInclude,
    DeepExclude,
}

/// Score weights: one row per [`Kind`], one weight per term.
pub(super) type Weights = [[f32; TERMS]; 6];

/// Fitted by `fitting.rs`: one row per [`Kind`], one weight per term.
#[rustfmt::skip]
pub(super) const WEIGHTS: Weights = [
    [-37.7001, 0.1882, -0.8458, 0.6662, -18.3394, 0.0000, -7.1185, 1.2843, -1.8756, 0.0341, -0.5004, 8.8754, 0.1882, 0.0000, 0.0000, 3.6995, 3.0869, -5.2035, -1.1709, -4.7081, 3.0330, 0.0000, 0.0000, 0.0000, 0.0000, -0.0468, -0.0745, -1.3597, 0.0075, -0.2158],
    [-6.7091, -0.3873, -1.0599, 0.3738, -2.3094, 9.1586, 0.7743, 0.3659, 0.0081, -0.0155, -0.1780, 1.3879, -0.2824, -0.2650, -0.9606, 0.8898, -0.3027, -5.7145, 1.0090, -2.9026, -2.6769, 0.0000, 0.0000, 0.0000, 0.0000, -0.0811, -0.8913, -1.1939, 0.0007, 0.0416],
    [-6.8915, -0.2429, -0.7814, 0.2644, -2.8330, 4.4956, 5.7354, 0.7081, -0.2231, -0.0805, -0.3063, 1.8559, -0.2895, -0.1409, -2.1545, 2.8192, 1.2675, 1.8264, -0.4805, -0.3755, -0.6290, 0.0000, 0.0000, 0.0000, 0.0000, -0.0321, -0.6236, -1.8092, -0.0118, -0.0124],
    [-7.5075, 0.1381, -1.9733, 1.8350, -0.3701, 0.0000, -4.9901, 0.9730, -1.0164, -0.0106, 0.2213, -3.8657, 0.1381, 0.4800, -0.2521, -0.1656, -1.3696, 4.4983, -2.3585, 0.7094, 0.4701, 3.6935, 0.0000, 1.8468, -2.2070, -0.0940, -1.0164, -1.1827, 0.0016, -0.4332],
    [-4.9317, -0.5438, -1.3584, 0.2975, -1.1277, 8.4362, -6.9917, -0.6554, -0.3229, -0.0099, -0.1326, 0.9334, -0.3392, 0.0449, -0.0994, 0.4558, 0.6526, -0.1923, -0.3450, 0.1130, 1.8337, 2.6427, 1.6170, 0.8885, -0.2277, -0.1506, -1.1209, -0.2016, -0.0016, -0.1538],
    [-7.9098, -0.0493, -1.0844, 0.7744, -3.6256, 3.6557, 8.8764, 0.1018, 0.6629, 0.0135, -0.3217, 1.4807, -0.0830, -0.1448, -2.6841, 1.2942, -0.0181, -4.6077, -0.0496, 1.2646, -1.0055, -0.6205, 0.0755, -0.2803, -0.3626, 0.0119, -0.6419, -0.6871, 0.0005, 0.0698],
];

/// How far the scores are trusted, per [`Kind`]: 0 = all candidates alike, large = the best score alone.
const SHARPNESS: [f32; 6] = [0.5, 0.7, 1.0, 0.6, 1.0, 0.5];

/// The kind of the click of a situation.
pub(super) fn kind_of(situation: &Situation<'_>) -> Kind {
    let is_first = situation.include && situation.area == 0.0;
    match (situation.same_thing.is_some(), situation.include) {
        (false, _) if is_first => Kind::First,
        (false, true) => Kind::Include,
        (false, false) => Kind::Exclude,
        (true, _) if is_first => Kind::DeepFirst,
        (true, true) => Kind::DeepInclude,
        (true, false) => Kind::DeepExclude,
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

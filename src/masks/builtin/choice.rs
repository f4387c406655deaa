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
    [-3.3215, 0.0736, -1.9140, 0.8265, 5.0951, 0.0000, -4.0034, 0.6020, -1.3362, 0.0201, 0.0981, 1.5053, 0.0736, 0.3736, -4.8394, 4.3741, -2.8637, 7.4917, -1.6311, -1.6016, -2.3095, -1.9049, 0.0000, -0.9524, -0.7331, -0.0909, -0.9169, -0.5576, 0.0036, -0.3948],
    [-4.5233, -0.3980, -0.9013, 0.1842, -0.7540, 6.7097, -4.9491, -0.2858, -0.4039, 0.0134, -0.1074, 2.1217, -0.2380, -0.0973, -1.6238, 0.1554, 1.1091, -2.0884, -0.2117, 0.4495, 3.3694, 0.9718, 1.0182, 3.7027, -0.1318, -0.1226, -1.0968, -0.1282, 0.0001, -0.1717],
    [-8.2955, 0.0245, -1.3825, 0.2796, -3.0557, 5.1711, 7.6716, 1.3736, 1.1408, 0.0458, 0.0394, 0.3319, 0.0396, -0.1898, -3.7886, 0.9315, -0.9471, -6.1570, -0.1339, 0.9201, 0.8027, 2.5977, 0.1438, -2.3473, -0.4059, 0.0099, -1.1505, -0.6249, 0.0013, 0.1006],
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

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
    [-12.1847, 0.0066, -1.2576, 0.6960, -4.6737, 0.0000, -1.9055, 0.3709, -1.9778, 0.0027, -0.1309, 5.4243, 0.0066, 0.3170, -3.6706, 5.0446, -2.7013, 4.8912, -1.3349, -0.8889, -2.6104, -1.5322, 0.0000, -0.7661, -0.5221, -0.0551, -0.9340, -0.4251, 0.0021, -0.2258],
    [-4.5388, -0.5531, -1.0590, 0.1720, -1.1401, 8.1222, -2.5462, -0.6635, -0.2627, -0.0168, -0.2212, 1.0333, -0.3552, -0.0144, -0.4912, 0.3857, -0.0784, -2.3589, -0.5217, 0.0648, 2.7100, 1.2600, 1.2631, 0.8252, -0.1200, -0.1395, -0.8591, -0.1466, -0.0021, -0.4233],
    [-2.3206, 0.0359, -1.4736, 0.5934, -3.7295, 5.1941, 17.2514, 0.9976, 1.4167, 0.0543, -0.1726, 0.3361, 0.0610, -0.1928, -3.0971, 1.8215, 0.0848, -5.0021, -0.1914, -0.6538, 1.2594, 3.4329, -0.2100, -2.8627, -0.1115, 0.0515, -0.9108, -0.5113, 0.0002, 0.1457],
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

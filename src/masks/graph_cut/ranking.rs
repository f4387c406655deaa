//! Ranks the candidates of a click.

use super::candidate_features::{CandidateFeatures, FEATURES};
use super::click_context::ClickContext;
use crate::AnswerSize;
use crate::answer_size::sized;

/// Features whose squares are terms as well, scaled by [`SQUARE_SCALE`].
const SQUARED: [usize; 5] = [1, 2, 3, 9, 12];
const SQUARE_SCALE: f32 = 0.3;

/// Number of terms of a score.
pub const TERMS: usize = FEATURES + SQUARED.len();

/// Kind of a click; each kind has its own weights.
///
/// Kinds without depth come first, then those with depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ClickKind {
    /// The first include click of an object, without depth.
    First,
    /// A further include click, without depth.
    Include,
    /// An exclude click, without depth.
    Exclude,
    /// The first include click of an object, with depth.
    DeepFirst,
    /// A further include click, with depth.
    DeepInclude,
    /// An exclude click, with depth.
    DeepExclude,
}

/// Score weights: one row per [`ClickKind`], one weight per term.
pub type Weights = [[f32; TERMS]; 6];

/// Fitted weights: one row per [`ClickKind`], one weight per term.
///
/// Fitted by `tests/bench/segmenter_fit`. With depth, it was fitted on a real shelf, on views of
/// synthetic plants (seeds 2–11) and on bricks.
///
/// The weight of the last feature is set by hand and must be kept when all others are fitted again.
/// Without depth, a late click rarely means a large part of the answer (−1 over `SHARPNESS`, except
/// for the first click). A fit to the mean gain of all clicks hardly notices the few clicks that
/// remove or add such a part.
///
/// Without that weight, some clicks without depth removed a torso or a head together with the
/// error. The weight also applies to clicks of rival labels, since a prompt does not distinguish
/// them, and restoring what one click removed costs as much. With depth, which shows where an
/// object ends, it had no effect (`cargo bench --bench segmenter -- davis shelf`).
#[rustfmt::skip]
pub const WEIGHTS: Weights = [
    [-37.7001, 0.1882, -0.8458, 0.6662, -18.3394, 0.0000, -7.1185, 1.2843, -1.8756, 0.0341, -0.5004, 8.8754, 0.1882, 0.0000, 0.0000, 3.6995, 3.0869, -5.2035, -1.1709, -4.7081, 3.0330, 0.0000, 0.0000, 0.0000, 0.0000, 0.0000, -0.0468, -0.0745, -1.3597, 0.0075, -0.2158],
    [-6.7091, -0.3873, -1.0599, 0.3738, -2.3094, 9.1586, 0.7743, 0.3659, 0.0081, -0.0155, -0.1780, 1.3879, -0.2824, -0.2650, -0.9606, 0.8898, -0.3027, -5.7145, 1.0090, -2.9026, -2.6769, 0.0000, 0.0000, 0.0000, 0.0000, -1.4286, -0.0811, -0.8913, -1.1939, 0.0007, 0.0416],
    [-6.8915, -0.2429, -0.7814, 0.2644, -2.8330, 4.4956, 5.7354, 0.7081, -0.2231, -0.0805, -0.3063, 1.8559, -0.2895, -0.1409, -2.1545, 2.8192, 1.2675, 1.8264, -0.4805, -0.3755, -0.6290, 0.0000, 0.0000, 0.0000, 0.0000, -1.0000, -0.0321, -0.6236, -1.8092, -0.0118, -0.0124],
    [-23.1545, 0.1398, -1.0624, 1.2063, -6.7893, 0.0000, -2.5008, 0.3008, -1.4593, -0.0160, -0.6220, 3.6106, 0.1398, 0.2379, -1.4824, 0.5571, -3.3389, 6.6721, -0.2390, 3.7101, 0.1771, 4.5339, 0.0000, 2.2670, -2.1455, 0.0000, -0.0483, -0.8450, -0.7889, 0.0010, -0.2483],
    [-1.6193, -0.2622, -1.1333, 0.3166, -0.6049, 7.5104, -6.9468, -0.6244, 0.0448, 0.0120, -0.1018, 1.3592, -0.1905, -0.0594, -2.4731, 0.2711, 0.9577, -0.9961, -0.2577, -0.0295, 1.8532, 2.5627, 1.0519, 2.0936, -0.2709, 0.0000, -0.1032, -1.7453, -0.2962, 0.0010, 0.0520],
    [-7.2509, -0.0555, -1.0001, 0.5564, -2.2938, 5.0224, 1.3872, 0.1545, 1.0942, 0.0314, -0.3785, 0.1716, -0.0913, -0.1800, -3.4572, 1.0182, -0.3662, -2.9879, -0.0626, 0.5298, -0.2297, 0.6221, 0.7414, 1.8741, -0.1026, 0.0000, 0.0170, -0.4638, -0.6082, 0.0014, 0.0598],
];

/// How far scores are trusted, per [`ClickKind`]: 0 = all candidates equal, large = only the best score.
const SHARPNESS: [f32; 6] = [0.5, 0.7, 1.0, 0.6, 1.0, 0.5];

/// Returns the kind of the click of a context.
pub(super) fn kind_of(context: &ClickContext<'_>) -> ClickKind {
    let is_first = context.include && context.area == 0.0;
    match (context.same_thing.is_some(), context.include) {
        (false, _) if is_first => ClickKind::First,
        (false, true) => ClickKind::Include,
        (false, false) => ClickKind::Exclude,
        (true, _) if is_first => ClickKind::DeepFirst,
        (true, true) => ClickKind::DeepInclude,
        (true, false) => ClickKind::DeepExclude,
    }
}

/// Returns the terms of a score: all features and the selected squares.
pub(super) fn terms(features: &CandidateFeatures) -> [f32; TERMS] {
    std::array::from_fn(|at| match at.checked_sub(FEATURES) {
        None => features[at],
        Some(square) => SQUARE_SCALE * features[SQUARED[square]] * features[SQUARED[square]],
    })
}

/// Returns the candidate with the highest expected IoU with the intended change.
///
/// The scores of the `terms` give the probability of each candidate; `shared` holds the IoU of
/// every two candidates. Returns `None` if there is no candidate.
#[must_use]
pub fn best(
    weights: &Weights,
    kind: ClickKind,
    terms: &[[f32; TERMS]],
    shared: &[Vec<f32>],
) -> Option<usize> {
    let weights = &weights[kind as usize];
    let score = |terms: &[f32; TERMS]| -> f32 {
        SHARPNESS[kind as usize]
            * terms
                .iter()
                .zip(weights)
                .map(|(term, weight)| term * weight)
                .sum::<f32>()
    };
    let scores: Vec<f32> = terms.iter().map(score).collect();
    expected_best(&scores, shared)
}

/// Share of the image above which a first answer without depth is implausible.
///
/// On rendered rice plants, one click on an organ took more than a fifth of the image besides it in
/// 26 % of 53 and 17 % of 65 cases without this limit and the next, in 19 % and 11 % with them.
/// Since thin structures are followed, 4 % and 0 % are left
/// (`cargo bench --bench clicks -- first tiller`).
const MOST_OF_IMAGE: f32 = 0.3;

/// Share of the image's outline above which a first answer without depth is implausible.
const MOST_OF_RIM: f32 = 0.5;

/// How much of the image a candidate changes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ChangeExtent {
    /// Number of pixels of the reduced image.
    pub area: f32,
    /// Share of the image, 0–1.
    pub share: f32,
    /// Share of the image's outline, 0–1.
    pub rim: f32,
}

impl ChangeExtent {
    /// Returns whether one object that was clicked may be so large.
    fn is_plausible(self) -> bool {
        self.share <= MOST_OF_IMAGE && self.rim <= MOST_OF_RIM
    }
}

/// The candidates of a click, as they are ranked.
pub(super) struct RankedCandidates<'a> {
    pub kind: ClickKind,
    /// Terms of the score, per candidate.
    pub terms: &'a [[f32; TERMS]],
    /// IoU of every two candidates.
    pub shared: &'a [Vec<f32>],
}

impl RankedCandidates<'_> {
    /// Returns the best candidate of a size; `extents` has the extent of each candidate.
    ///
    /// The first answer without depth is the best plausible one: what takes most of the image is
    /// rather its background. Larger sizes may take it. Returns `None` if there is no candidate.
    pub fn best_of_size(
        &self,
        weights: &Weights,
        extents: &[ChangeExtent],
        size: AnswerSize,
    ) -> Option<usize> {
        let best_among = |left: &[usize]| self.best_among(weights, left);
        let mut automatic = best(weights, self.kind, self.terms, self.shared)?;
        if self.kind == ClickKind::First && !extents[automatic].is_plausible() {
            let plausible = (0..extents.len()).filter(|&at| extents[at].is_plausible());
            automatic = best_among(&plausible.collect::<Vec<_>>()).unwrap_or(automatic);
        }
        let areas: Vec<f32> = extents.iter().map(|extent| extent.area).collect();
        Some(sized(&areas, automatic, size, best_among))
    }

    /// Returns the best candidate of a size if an answer that is not among them is the automatic
    /// one.
    ///
    /// `area` is that of the automatic answer, in pixels of the reduced image. Returns `None` if
    /// that answer has the size.
    pub fn best_beside(
        &self,
        weights: &Weights,
        extents: &[ChangeExtent],
        area: f32,
        size: AnswerSize,
    ) -> Option<usize> {
        let automatic = extents.len();
        let areas: Vec<f32> = extents
            .iter()
            .map(|extent| extent.area)
            .chain([area])
            .collect();
        let at = sized(&areas, automatic, size, |left| {
            let left: Vec<usize> = left.iter().copied().filter(|&at| at != automatic).collect();
            self.best_among(weights, &left)
        });
        (at != automatic).then_some(at)
    }

    /// Returns the best of some candidates, given by their indices.
    fn best_among(&self, weights: &Weights, left: &[usize]) -> Option<usize> {
        let terms: Vec<_> = left.iter().map(|&at| self.terms[at]).collect();
        let shared: Vec<Vec<f32>> = left
            .iter()
            .map(|&a| left.iter().map(|&b| self.shared[a][b]).collect())
            .collect();
        best(weights, self.kind, &terms, &shared).map(|at| left[at])
    }
}

/// Returns the row of `shared` with the largest mean, weighted by softmax of the scores.
///
/// Returns the first such row on ties, and `None` if there is none.
#[must_use]
pub fn expected_best(scores: &[f32], shared: &[Vec<f32>]) -> Option<usize> {
    let top = scores.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let chances: Vec<f32> = scores.iter().map(|score| (score - top).exp()).collect();
    let expected: Vec<f32> = shared
        .iter()
        .map(|row| {
            row.iter()
                .zip(&chances)
                .map(|(shared, chance)| shared * chance)
                .sum()
        })
        .collect();
    (0..expected.len())
        .rev()
        .max_by(|&a, &b| expected[a].total_cmp(&expected[b]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_answer_without_depth_does_not_take_the_background() {
        // The last candidate is the best one by its score.
        let terms: Vec<[f32; TERMS]> = (0..3).map(|at| [at as f32; TERMS]).collect();
        let mut weights = WEIGHTS;
        weights.iter_mut().for_each(|row| *row = [1.0; TERMS]);
        let shared: Vec<Vec<f32>> = (0..3)
            .map(|a| (0..3).map(|b| if a == b { 1.0 } else { 0.0 }).collect())
            .collect();
        let extent = |share: f32, rim: f32| ChangeExtent {
            area: 1000.0 * share,
            share,
            rim,
        };
        let chosen = |kind, extents: &[ChangeExtent], size| {
            let ranked = RankedCandidates {
                kind,
                terms: &terms,
                shared: &shared,
            };
            ranked.best_of_size(&weights, extents, size)
        };
        let wall = [extent(0.01, 0.0), extent(0.1, 0.1), extent(0.4, 0.2)];
        let first = |size| chosen(ClickKind::First, &wall, size);
        assert_eq!(first(AnswerSize::Automatic), Some(1));
        assert_eq!(first(AnswerSize::Smaller), Some(0));
        assert_eq!(first(AnswerSize::Larger), Some(2), "it can be asked for");
        let frame = [extent(0.01, 0.0), extent(0.1, 0.1), extent(0.2, 0.6)];
        let around = chosen(ClickKind::First, &frame, AnswerSize::Automatic);
        assert_eq!(around, Some(1));
        for kind in [ClickKind::Include, ClickKind::DeepFirst] {
            assert_eq!(chosen(kind, &wall, AnswerSize::Automatic), Some(2));
        }
        let all = [extent(0.5, 0.0), extent(0.6, 0.0), extent(0.7, 0.0)];
        let only = chosen(ClickKind::First, &all, AnswerSize::Automatic);
        assert_eq!(only, Some(2), "nothing smaller is known");
    }
}

//! Selection of the pairs of views whose features are compared. Their poses are known, so that no
//! pair is verified and nothing follows from pairs compared before.

use std::collections::BTreeSet;

use crate::sfm::Features;
use crate::sfm::retrieval::{Vocabulary, most_alike};

/// Up to this many views, every view is compared with every other.
const EXHAUSTIVE_UP_TO: usize = 60;
/// Number of following views that a view is compared with. Those 2, 4, 8, … further on are added.
const WINDOW: usize = 10;
/// Number of views that each is compared with because their appearance is most similar.
const ALIKE: usize = 10;

/// Returns the pairs of views to compare: ascending, first < second.
pub(super) fn pairs_to_compare(features: &[&Features]) -> Vec<(usize, usize)> {
    if features.len() <= EXHAUSTIVE_UP_TO {
        return every_pair(features.len());
    }
    let mut pairs = sequence_pairs(features.len(), WINDOW);
    let pooled = Vocabulary::learn(features, 0).pool_all(features);
    pairs.extend(most_alike(&pooled, ALIKE, &pairs));
    pairs.into_iter().collect()
}

fn every_pair(count: usize) -> Vec<(usize, usize)> {
    (0..count)
        .flat_map(|first| (first + 1..count).map(move |second| (first, second)))
        .collect()
}

/// Pairs every view with the next `window` ones and with those 2, 4, 8, … further on.
fn sequence_pairs(count: usize, window: usize) -> BTreeSet<(usize, usize)> {
    let doubling = (0..usize::BITS - 1)
        .map(|k| 1 << k)
        .take_while(|&step| window > 0 && step < count);
    let steps: BTreeSet<usize> = (1..=window).chain(doubling).collect();
    (0..count)
        .flat_map(|first| steps.iter().map(move |step| (first, first + step)))
        .filter(|&(_, second)| second < count)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sequences_pair_neighbours_and_doubling_steps() {
        let pairs = sequence_pairs(20, 3);
        let of_first: Vec<usize> = pairs
            .iter()
            .filter(|pair| pair.0 == 0)
            .map(|pair| pair.1)
            .collect();
        assert_eq!(of_first, [1, 2, 3, 4, 8, 16]);
        assert!(pairs.iter().all(|&(a, b)| a < b && b < 20));
        assert!(sequence_pairs(1, 3).is_empty() && sequence_pairs(9, 0).is_empty());
    }

    #[test]
    fn small_sets_are_compared_in_full() {
        let expected = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)];
        assert_eq!(every_pair(4), expected);
    }
}

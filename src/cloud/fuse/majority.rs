use std::collections::BTreeMap;

use ostra_masks::{LabelId, LabelTree};

/// The outcome of one point's vote.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Verdict {
    /// The winner; 0 = nothing won, or nobody voted.
    pub label: LabelId,
    /// Votes for the winner and what is below it in the tree, as a share of all votes, 0–1; 0 when nobody voted.
    pub confidence: f32,
}

/// Decides votes level by level: first among the top-level labels and *nothing*, each with the votes of all that is
/// below it, then among the winner's children and the winner itself, and so on down.
///
/// So a plant whose votes are split between two stems does not lose to a background that has more votes than either.
/// Ties: a label wins over nothing, a child over its parent, the smaller id over the larger.
#[derive(Debug, Clone)]
pub struct Majority {
    /// Ids from the top level down to the label, for each label below the top level.
    paths: BTreeMap<LabelId, Vec<LabelId>>,
}

impl Majority {
    /// Prepares the decision for a label tree; ids that the tree lacks count as top-level labels.
    #[must_use]
    pub fn new(tree: &LabelTree) -> Self {
        let paths = tree
            .iter()
            .filter(|label| label.parent.is_some())
            .map(|label| (label.id, tree.path(label.id)));
        Self {
            paths: paths.collect(),
        }
    }

    /// Decides one point's votes: (deepest id, votes), each id once.
    #[must_use]
    pub fn decide(&self, histogram: &[(LabelId, u16)]) -> Verdict {
        let total: u32 = histogram.iter().map(|&(_, votes)| u32::from(votes)).sum();
        let mut label = LabelId::NONE;
        let mut won = 0;
        for level in 0.. {
            let Some((next, votes)) = self.best(histogram, label, level) else {
                break;
            };
            won = votes;
            if next == label {
                break;
            }
            label = next;
        }
        let confidence = if total == 0 {
            0.0
        } else {
            won as f32 / total as f32
        };
        Verdict { label, confidence }
    }

    /// The candidate with most votes below `parent`, which stands at depth `level`, or `parent` itself.
    fn best(
        &self,
        histogram: &[(LabelId, u16)],
        parent: LabelId,
        level: usize,
    ) -> Option<(LabelId, u32)> {
        let mut best: Option<(LabelId, u32)> = None;
        for &(id, _) in histogram {
            let Some(candidate) = self.step(id, parent, level) else {
                continue;
            };
            let votes = histogram
                .iter()
                .filter(|&&(other, _)| self.step(other, parent, level) == Some(candidate))
                .map(|&(_, votes)| u32::from(votes))
                .sum();
            // Larger = better: votes, then a step down over staying, then the smaller id.
            let rank = |(id, votes): (LabelId, u32)| (votes, id != parent, std::cmp::Reverse(id));
            if best.is_none_or(|champion| rank((candidate, votes)) > rank(champion)) {
                best = Some((candidate, votes));
            }
        }
        best
    }

    /// Which way a vote for `id` points at depth `level` below `parent`: to a child, to `parent` itself, or nowhere.
    fn step(&self, id: LabelId, parent: LabelId, level: usize) -> Option<LabelId> {
        if id == parent {
            return Some(parent);
        }
        let Some(path) = self.paths.get(&id) else {
            return (level == 0).then_some(id);
        };
        let under = level == 0 || path.get(level - 1) == Some(&parent);
        if under {
            path.get(level).copied()
        } else {
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ostra_masks::Label;

    fn majority() -> Majority {
        let mut tree = LabelTree::default();
        for (id, parent) in [
            (1, None),
            (2, Some(1)),
            (3, Some(1)),
            (4, Some(3)),
            (5, None),
        ] {
            let label = Label {
                id: LabelId(id),
                name: id.to_string(),
                color: [0; 3],
                parent: parent.map(LabelId),
            };
            tree.set(label).unwrap();
        }
        Majority::new(&tree)
    }

    fn decide(votes: &[(u16, u16)]) -> (u16, f32) {
        let votes: Vec<_> = votes
            .iter()
            .map(|&(id, votes)| (LabelId(id), votes))
            .collect();
        let verdict = majority().decide(&votes);
        (verdict.label.0, verdict.confidence)
    }

    #[test]
    fn a_split_organ_does_not_lose_to_the_background() {
        assert_eq!(decide(&[(0, 4), (2, 3), (4, 2)]), (2, 3.0 / 9.0));
        assert_eq!(decide(&[(0, 5), (2, 1), (3, 1), (4, 2)]), (0, 5.0 / 9.0));
        assert_eq!(decide(&[(0, 1), (3, 1), (4, 2), (5, 3)]), (4, 2.0 / 7.0));
    }

    #[test]
    fn a_parent_keeps_what_its_children_do_not_win() {
        assert_eq!(decide(&[(1, 5), (2, 2), (4, 1)]), (1, 5.0 / 8.0));
        assert_eq!(decide(&[(1, 2), (2, 2)]), (2, 0.5));
    }

    #[test]
    fn ties_and_empty_votes() {
        assert_eq!(decide(&[]), (0, 0.0));
        assert_eq!(decide(&[(0, 3)]), (0, 1.0));
        assert_eq!(decide(&[(0, 1), (5, 1)]), (5, 0.5));
        assert_eq!(decide(&[(2, 1), (5, 1)]), (2, 0.5));
        assert_eq!(decide(&[(9, 1), (5, 1)]), (5, 0.5));
        assert_eq!(decide(&[(9, 2), (5, 1)]), (9, 2.0 / 3.0));
    }
}

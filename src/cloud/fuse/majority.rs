//! Vote counts per label, and the majority decision.

use std::collections::BTreeMap;

use rustc_hash::FxHashMap;

use ostra_masks::{LabelId, LabelTree};

/// The outcome of the vote on one point.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MajorityLabel {
    /// The winning label; 0 if no label won or there were no votes.
    pub label: LabelId,
    /// Votes for the winner and its descendants, as a share of all votes (0–1).
    ///
    /// It is 0 if there were no votes.
    pub confidence: f32,
}

/// Decides votes level by level through the label tree.
///
/// The first decision is among the top-level labels and *no label*, where each label has the votes
/// of its whole subtree. The next one is among the children of the winner and the winner itself,
/// and so on downwards.
///
/// This way a plant whose votes are split between two stems does not lose to a background that has
/// more votes than either stem. Ties are broken as follows: a label wins over no label, a child
/// over its parent, and a smaller id over a larger one.
#[derive(Debug, Clone)]
pub struct Majority {
    /// Path from the top level down to the label, for each label below the top level.
    paths: BTreeMap<LabelId, Vec<LabelId>>,
}

impl Majority {
    /// Creates the decision rule of a label tree.
    ///
    /// Ids that the tree lacks count as top-level labels.
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

    /// Decides the votes on one point, given as (deepest id, votes) with each id once.
    #[must_use]
    pub fn decide(&self, histogram: &[(LabelId, u16)]) -> MajorityLabel {
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
        MajorityLabel { label, confidence }
    }

    /// Returns the winner among the children of `parent` and `parent` itself, with its votes.
    ///
    /// The children are at index `level` of their paths.
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
            // Most votes first; in a tie a child beats its parent, then a smaller id a larger one.
            let rank = |(id, votes): (LabelId, u32)| (votes, id != parent, std::cmp::Reverse(id));
            if best.is_none_or(|champion| rank((candidate, votes)) > rank(champion)) {
                best = Some((candidate, votes));
            }
        }
        best
    }

    /// Returns the candidate that a vote for `id` supports: a child of `parent` or `parent` itself.
    ///
    /// Returns `None` if `id` is outside the subtree. `level` is the index of the children in their
    /// paths.
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

/// Number of distinct ids that most points do not exceed.
const INLINE: usize = 4;

/// Vote counts of a chunk of points.
///
/// A few (id, votes) entries are stored inline per point; the others go to a hash map.
#[derive(Debug, Clone, Default)]
pub(super) struct LabelHistograms {
    points: Vec<[(LabelId, u16); INLINE]>,
    overflow: FxHashMap<(u32, LabelId), u16>,
}

/// The histograms of consecutive points.
///
/// Holds the number of entries per point, and all (id, votes) entries, ordered by id within a
/// point.
pub(super) type Histograms = (Vec<u32>, Vec<(LabelId, u16)>);

impl LabelHistograms {
    pub(super) fn new(points: usize) -> Self {
        Self {
            points: vec![[(LabelId::NONE, 0); INLINE]; points],
            overflow: FxHashMap::default(),
        }
    }

    /// Creates ballots from existing histograms, given in point order.
    pub(super) fn from_histograms<'a>(
        histograms: impl ExactSizeIterator<Item = &'a [(LabelId, u16)]>,
    ) -> Self {
        let mut ballots = Self::new(histograms.len());
        for (point, histogram) in histograms.enumerate() {
            for (place, &entry) in histogram.iter().enumerate() {
                match ballots.points[point].get_mut(place) {
                    Some(slot) => *slot = entry,
                    None => drop(ballots.overflow.insert((point as u32, entry.0), entry.1)),
                }
            }
        }
        ballots
    }

    /// Adds one vote. The count saturates at 65535.
    pub(super) fn add(&mut self, point: u32, id: LabelId) {
        let slots = &mut self.points[point as usize];
        let known = slots.iter().position(|slot| slot.0 == id && slot.1 > 0);
        let place = known.or_else(|| slots.iter().position(|slot| slot.1 == 0));
        match place {
            Some(place) => slots[place] = (id, slots[place].1.saturating_add(1)),
            None => {
                let votes = self.overflow.entry((point, id)).or_default();
                *votes = votes.saturating_add(1);
            }
        }
    }

    /// Removes one vote, if there is one.
    pub(super) fn remove(&mut self, point: u32, id: LabelId) {
        let slot = self.points[point as usize]
            .iter_mut()
            .find(|slot| slot.0 == id && slot.1 > 0);
        if let Some(slot) = slot {
            slot.1 -= 1;
        } else if let Some(votes) = self.overflow.get_mut(&(point, id)) {
            *votes = votes.saturating_sub(1);
        }
    }

    /// Returns the counted histograms.
    pub(super) fn finish(&self) -> Histograms {
        let (mut counts, mut entries) = (Vec::with_capacity(self.points.len()), Vec::new());
        let mut adjacent: Vec<(u32, LabelId, u16)> = self
            .overflow
            .iter()
            .map(|(&(point, id), &votes)| (point, id, votes))
            .collect();
        adjacent.sort_unstable();
        let mut adjacent = adjacent.into_iter().peekable();
        let mut own: Vec<(LabelId, u16)> = Vec::new();
        for (point, slots) in self.points.iter().enumerate() {
            own.clear();
            own.extend(slots);
            while let Some((_, id, votes)) = adjacent.next_if(|&(of, _, _)| of as usize == point) {
                own.push((id, votes));
            }
            own.retain(|&(_, votes)| votes > 0);
            own.sort_unstable();
            // After votes were removed, an id may have both an inline and an overflow entry.
            own.dedup_by(|later, first| {
                let same = later.0 == first.0;
                first.1 = if same {
                    first.1.saturating_add(later.1)
                } else {
                    first.1
                };
                same
            });
            counts.push(own.len() as u32);
            entries.extend_from_slice(&own);
        }
        (counts, entries)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use proptest::prelude::*;

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
    fn votes_split_between_children_beat_the_background() {
        assert_eq!(decide(&[(0, 4), (2, 3), (4, 2)]), (2, 3.0 / 9.0));
        assert_eq!(decide(&[(0, 5), (2, 1), (3, 1), (4, 2)]), (0, 5.0 / 9.0));
        assert_eq!(decide(&[(0, 1), (3, 1), (4, 2), (5, 3)]), (4, 2.0 / 7.0));
    }

    #[test]
    fn parent_wins_when_it_outvotes_its_children() {
        assert_eq!(decide(&[(1, 5), (2, 2), (4, 1)]), (1, 5.0 / 8.0));
        assert_eq!(decide(&[(1, 2), (2, 2)]), (2, 0.5));
    }

    #[test]
    fn ties_prefer_labels_children_and_small_ids() {
        assert_eq!(decide(&[]), (0, 0.0));
        assert_eq!(decide(&[(0, 3)]), (0, 1.0));
        assert_eq!(decide(&[(0, 1), (5, 1)]), (5, 0.5));
        assert_eq!(decide(&[(2, 1), (5, 1)]), (2, 0.5));
        assert_eq!(decide(&[(9, 1), (5, 1)]), (5, 0.5));
        assert_eq!(decide(&[(9, 2), (5, 1)]), (9, 2.0 / 3.0));
    }

    proptest! {
        #[test]
        fn ballots_count_like_a_map(steps in prop::collection::vec((0u32..3, 0u16..9, any::<bool>()), 0..200)) {
            let mut ballots = LabelHistograms::new(3);
            let mut plain: BTreeMap<(u32, LabelId), u16> = BTreeMap::new();
            for (point, id, add) in steps {
                let id = LabelId(id);
                let votes = plain.entry((point, id)).or_default();
                if add {
                    ballots.add(point, id);
                    *votes += 1;
                } else {
                    ballots.remove(point, id);
                    *votes = votes.saturating_sub(1);
                }
            }
            let (counts, entries) = ballots.finish();
            plain.retain(|_, votes| *votes > 0);
            prop_assert_eq!(entries.clone(), plain.iter().map(|(&(_, id), &votes)| (id, votes)).collect::<Vec<_>>());
            let mut rest = &entries[..];
            let histograms: Vec<_> = counts.iter().map(|&n| rest.split_off(..n as usize).unwrap()).collect();
            let again = LabelHistograms::from_histograms(histograms.into_iter()).finish();
            prop_assert_eq!(again, (counts, entries));
        }
    }
}

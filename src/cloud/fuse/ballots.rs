use rustc_hash::FxHashMap;

use ostra_masks::LabelId;

/// Different ids that most points stay within.
const INLINE: usize = 4;

/// The votes of a chunk of points while they are counted: a few (id, votes) beside each point, the rest apart.
#[derive(Debug, Clone, Default)]
pub(super) struct Ballots {
    points: Vec<[(LabelId, u16); INLINE]>,
    overflow: FxHashMap<(u32, LabelId), u16>,
}

/// The histograms of consecutive points: entries of each point, and all (id, votes), ordered by id within a point.
pub(super) type Histograms = (Vec<u32>, Vec<(LabelId, u16)>);

impl Ballots {
    pub(super) fn new(points: usize) -> Self {
        Self {
            points: vec![[(LabelId::NONE, 0); INLINE]; points],
            overflow: FxHashMap::default(),
        }
    }

    /// Ballots that hold histograms already counted, in the order of the points.
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

    /// One vote more; the count stops at 65535.
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

    /// One vote less, where there is one.
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

    /// What was counted.
    pub(super) fn finish(&self) -> Histograms {
        let (mut counts, mut entries) = (Vec::with_capacity(self.points.len()), Vec::new());
        let mut beside: Vec<(u32, LabelId, u16)> = self
            .overflow
            .iter()
            .map(|(&(point, id), &votes)| (point, id, votes))
            .collect();
        beside.sort_unstable();
        let mut beside = beside.into_iter().peekable();
        let mut own: Vec<(LabelId, u16)> = Vec::new();
        for (point, slots) in self.points.iter().enumerate() {
            own.clear();
            own.extend(slots);
            while let Some((_, id, votes)) = beside.next_if(|&(of, _, _)| of as usize == point) {
                own.push((id, votes));
            }
            own.retain(|&(_, votes)| votes > 0);
            own.sort_unstable();
            // An id may stand in both places after votes were taken back.
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
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeMap;

    proptest! {
        #[test]
        fn counts_like_a_map(steps in prop::collection::vec((0u32..3, 0u16..9, any::<bool>()), 0..200)) {
            let mut ballots = Ballots::new(3);
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
            let again = Ballots::from_histograms(histograms.into_iter()).finish();
            prop_assert_eq!(again, (counts, entries));
        }
    }
}

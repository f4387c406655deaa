use std::ops::RangeInclusive;

use serde::{Deserialize, Serialize};

/// A set of frame numbers, stored as increasing ranges that neither overlap nor touch.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(from = "Vec<(usize, usize)>", into = "Vec<(usize, usize)>")]
pub struct FrameSet {
    /// First and last (inclusive) number of each range.
    ranges: Vec<(usize, usize)>,
}

impl FrameSet {
    /// Returns whether the set contains no frame.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.ranges.is_empty()
    }

    /// Returns whether the set contains a frame.
    #[must_use]
    pub fn contains(&self, frame: usize) -> bool {
        self.range_of(frame).is_some()
    }

    /// Returns the range that contains a frame of the set.
    #[must_use]
    pub fn range_of(&self, frame: usize) -> Option<RangeInclusive<usize>> {
        let next = self.ranges.partition_point(|&(first, _)| first <= frame);
        let (first, last) = *self.ranges.get(next.checked_sub(1)?)?;
        (frame <= last).then_some(first..=last)
    }

    /// Returns the highest number in the set.
    #[must_use]
    pub fn last(&self) -> Option<usize> {
        self.ranges.last().map(|&(_, last)| last)
    }

    /// Returns the ranges in increasing order.
    pub fn ranges(&self) -> impl Iterator<Item = RangeInclusive<usize>> + '_ {
        self.ranges.iter().map(|&(first, last)| first..=last)
    }

    /// Inserts `first` to `last` (inclusive); nothing if `first` is greater than `last`.
    pub fn insert(&mut self, first: usize, last: usize) {
        if first > last {
            return;
        }
        let (mut first, mut last) = (first, last);
        self.ranges.retain(|&(a, b)| {
            let touches = a <= last.saturating_add(1) && first <= b.saturating_add(1);
            if touches {
                (first, last) = (first.min(a), last.max(b));
            }
            !touches
        });
        let at = self.ranges.partition_point(|&(a, _)| a < first);
        self.ranges.insert(at, (first, last));
    }

    /// Removes `first` to `last` (inclusive).
    pub fn remove(&mut self, first: usize, last: usize) {
        let rest = |&(a, b): &(usize, usize)| {
            let before = (a < first).then(|| (a, b.min(first - 1)));
            let after = (b > last).then(|| (a.max(last + 1), b));
            before.into_iter().chain(after)
        };
        if first <= last {
            self.ranges = self.ranges.iter().flat_map(rest).collect();
        }
    }
}

impl From<Vec<(usize, usize)>> for FrameSet {
    /// Returns the union of ranges in any order; a range that ends before its start is empty.
    fn from(ranges: Vec<(usize, usize)>) -> Self {
        let mut set = Self::default();
        ranges
            .into_iter()
            .for_each(|(first, last)| set.insert(first, last));
        set
    }
}

impl From<FrameSet> for Vec<(usize, usize)> {
    fn from(set: FrameSet) -> Self {
        set.ranges
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn set_equals_a_plain_set_of_numbers(steps in proptest::collection::vec((any::<bool>(), 0usize..30, 0usize..30), 0..12)) {
            let (mut set, mut plain) = (FrameSet::default(), BTreeSet::new());
            for (put, first, last) in steps {
                if put {
                    set.insert(first, last);
                    plain.extend(first..=last);
                } else {
                    set.remove(first, last);
                    plain.retain(|frame| !(first..=last).contains(frame));
                }
            }
            prop_assert_eq!(set.ranges().flatten().collect::<BTreeSet<_>>(), plain.clone());
            for frame in 0..32 {
                prop_assert_eq!(set.contains(frame), plain.contains(&frame));
            }
            prop_assert_eq!((set.is_empty(), set.last()), (plain.is_empty(), plain.last().copied()));
            let ranges: Vec<_> = set.ranges().collect();
            prop_assert!(ranges.windows(2).all(|pair| pair[0].end() + 1 < *pair[1].start()), "{:?}", ranges);
            let text = serde_json::to_string(&set).unwrap();
            prop_assert_eq!(serde_json::from_str::<FrameSet>(&text).unwrap(), set);
        }
    }

    #[test]
    fn largest_number_is_supported() {
        let mut set = FrameSet::default();
        set.insert(3, usize::MAX);
        set.insert(0, 2);
        assert_eq!(set.range_of(7), Some(0..=usize::MAX));
        set.remove(5, usize::MAX);
        assert_eq!(set.range_of(1), Some(0..=4));
    }
}

use std::ops::Bound;

use crate::{FrameMask, MaskOrigin, Project};

impl Project {
    /// The anchors next to a frame: the last before it and the first after it.
    #[must_use]
    pub fn neighbour_anchors(&self, frame: usize) -> (Option<usize>, Option<usize>) {
        let is_anchor = |(_, mask): &(&usize, &FrameMask)| mask.origin == MaskOrigin::Anchor;
        let later = (Bound::Excluded(frame), Bound::Unbounded);
        let before = self.masks.range(..frame).rev().find(is_anchor);
        let after = self.masks.range(later).find(is_anchor);
        (
            before.map(|(&number, _)| number),
            after.map(|(&number, _)| number),
        )
    }
}

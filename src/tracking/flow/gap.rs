use ostra_masks::{Direction, TrackRequest};

/// Frames in a row that lie between the same anchors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Gap {
    /// First and last frame asked for.
    pub from: usize,
    pub to: usize,
    /// The anchor before them that their masks come from, and the one after.
    pub before: Option<usize>,
    pub after: Option<usize>,
}

impl Gap {
    /// Steps from frame to frame that it takes.
    pub fn steps(&self) -> usize {
        self.before.map_or(0, |anchor| self.to - anchor)
            + self.after.map_or(0, |anchor| anchor - self.from)
    }

    /// How near the anchor before a frame is, from 1 at it to 0 at the anchor after; `None` where one of them is missing.
    pub fn nearness(&self, frame: usize) -> Option<f32> {
        let (before, after) = self.before.zip(self.after)?;
        Some((after as f32 - frame as f32) / (after - before) as f32)
    }

    /// How much the mask of the frame `beyond`, which comes from one anchor, counts beside that of `own`, which comes from the
    /// other, 0–1: as each is near its anchor.
    pub fn share_beyond(&self, beyond: usize, own: usize) -> Option<f32> {
        let (of_beyond, of_own) = (self.nearness(beyond)?, self.nearness(own)?);
        let (beyond, own) = if beyond < own {
            (of_beyond, 1.0 - of_own)
        } else {
            (1.0 - of_beyond, of_own)
        };
        Some(beyond / (beyond + own))
    }
}

/// The gaps of a request that masks can be carried into, in order.
pub(super) fn gaps(request: &TrackRequest) -> Vec<Gap> {
    let mut gaps: Vec<Gap> = Vec::new();
    for frame in (request.from..=request.to).filter(|frame| !request.anchors.contains_key(frame)) {
        let before = request
            .anchors
            .range(..frame)
            .next_back()
            .map(|(&anchor, _)| anchor);
        let after = request
            .anchors
            .range(frame..)
            .next()
            .map(|(&anchor, _)| anchor);
        let before = before.filter(|_| request.direction != Direction::Backward);
        let after = after.filter(|_| request.direction != Direction::Forward);
        match gaps.last_mut() {
            Some(gap) if gap.to + 1 == frame => gap.to = frame,
            _ if before.is_some() || after.is_some() => gaps.push(Gap {
                from: frame,
                to: frame,
                before,
                after,
            }),
            _ => {}
        }
    }
    gaps
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_two_frames_the_one_nearer_to_its_anchor_counts_more() {
        let gap = Gap {
            from: 11,
            to: 17,
            before: Some(10),
            after: Some(18),
        };
        assert_eq!(
            [10, 14, 18].map(|frame| gap.nearness(frame)),
            [Some(1.0), Some(0.5), Some(0.0)]
        );
        assert_eq!(gap.share_beyond(10, 12), Some(0.8));
        assert_eq!(gap.share_beyond(13, 15), Some(0.5));
        assert_eq!(gap.share_beyond(18, 16), Some(0.8));
        let one_frame = Gap {
            from: 11,
            to: 11,
            before: Some(10),
            after: Some(12),
        };
        assert_eq!(
            [
                one_frame.share_beyond(10, 12),
                one_frame.share_beyond(12, 10)
            ],
            [Some(0.5); 2]
        );
        assert_eq!(Gap { after: None, ..gap }.share_beyond(13, 15), None);
    }
}

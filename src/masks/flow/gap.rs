use crate::masks::{Direction, TrackRequest};

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
        self.before.map_or(0, |anchor| self.to - anchor) + self.after.map_or(0, |anchor| anchor - self.from)
    }
}

/// The gaps of a request that masks can be carried into, in order.
pub(super) fn gaps(request: &TrackRequest) -> Vec<Gap> {
    let mut gaps: Vec<Gap> = Vec::new();
    for frame in (request.from..=request.to).filter(|frame| !request.anchors.contains_key(frame)) {
        let before = request.anchors.range(..frame).next_back().map(|(&anchor, _)| anchor);
        let after = request.anchors.range(frame..).next().map(|(&anchor, _)| anchor);
        let before = before.filter(|_| request.direction != Direction::Backward);
        let after = after.filter(|_| request.direction != Direction::Forward);
        match gaps.last_mut() {
            Some(gap) if gap.to + 1 == frame => gap.to = frame,
            _ if before.is_some() || after.is_some() => gaps.push(Gap { from: frame, to: frame, before, after }),
            _ => {}
        }
    }
    gaps
}

use std::collections::VecDeque;

use crate::fuse::Votes;
use ostra_masks::{LabelId, LabelMask, Region};

/// A frame's mask with the pixels of `inside` given to what the points chose that the frame sees there: a pixel takes
/// the choice of the nearest pixel that sees a point, on a way through pixels of `inside`. `choice` runs along the
/// points of `votes`, `None` chooses nothing. `None` where no pixel changes.
#[must_use]
pub fn split_mask(
    votes: &Votes,
    choice: &[Option<LabelId>],
    (frame, mask): (usize, &LabelMask),
    mut inside: Region,
) -> Option<LabelMask> {
    let mut split = mask.clone();
    let mut open = VecDeque::new();
    for (point, x, y) in votes.sightings(frame) {
        let Some(chosen) = choice[point].filter(|_| x < mask.width && y < mask.height) else {
            continue;
        };
        let at = y as usize * mask.width as usize + x as usize;
        if std::mem::take(&mut inside.inside[at]) {
            split.ids[at] = chosen;
            open.push_back(at);
        }
    }
    if open.is_empty() {
        return None;
    }
    while let Some(at) = open.pop_front() {
        for next in beside(at, mask.width as usize, mask.ids.len())
            .into_iter()
            .flatten()
        {
            if std::mem::take(&mut inside.inside[next]) {
                split.ids[next] = split.ids[at];
                open.push_back(next);
            }
        }
    }
    Some(split)
}

/// The pixels that share a side with one.
fn beside(at: usize, width: usize, count: usize) -> [Option<usize>; 4] {
    let column = at % width;
    [
        at.checked_sub(width),
        (column > 0).then(|| at - 1),
        (column + 1 < width).then_some(at + 1),
        (at + width < count).then_some(at + width),
    ]
}

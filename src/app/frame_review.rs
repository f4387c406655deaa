//! What is derived from all frames, computed again only when the project changes.

use super::SessionView;
use ostra_project::review::{CONFLICT_ABOVE, Review, ReviewCriteria, review};
use ostra_project::{FrameMask, MaskOrigin, Presence};

/// Confirmed frames, frames to check, and the heat of every frame.
///
/// A project may have thousands of frames, and the window is drawn sixty times a second.
#[derive(Default)]
pub struct FrameReview {
    key: Option<ReviewKey>,
    /// Labels present on each frame.
    pub presence: Presence,
    /// Confirmed frames and frames to check.
    pub review: Review,
    /// Heat of each frame.
    pub(super) heat: Vec<FrameHeat>,
}

#[derive(Clone, Copy, PartialEq)]
struct ReviewKey {
    revision: u64,
    flag_below: f32,
}

/// State of a frame as the strip above the filmstrip shows it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum FrameHeat {
    /// No mask.
    Empty,
    /// A keyframe without a notable conflict with the vote.
    Confirmed,
    /// Its inputs have changed since it was made.
    Stale,
    /// Lowest confidence of tracker and vote, 0–1; 0 if a label was lost.
    Confidence(f32),
}

impl FrameReview {
    /// Computes everything again if the project, its conflicts or the limit changed.
    pub(super) fn update(&mut self, session: &SessionView<'_>, flag_below: f32) {
        let key = ReviewKey {
            revision: session.revision,
            flag_below,
        };
        if self.key == Some(key) {
            return;
        }
        self.key = Some(key);
        self.presence.update(session.project);
        let criteria = ReviewCriteria {
            flag_below,
            conflicts: session.conflicts,
        };
        self.review = review(session.project, &self.presence, criteria);
        let masks = &session.project.masks;
        self.heat = (0..session.project.frames.len())
            .map(|frame| match masks.get(&frame) {
                Some(mask) => heat_of(session, &self.presence, flag_below, frame, mask),
                None => FrameHeat::Empty,
            })
            .collect();
    }
}

fn heat_of(
    session: &SessionView<'_>,
    presence: &Presence,
    flag_below: f32,
    frame: usize,
    mask: &FrameMask,
) -> FrameHeat {
    // At twice the share that flags a frame, nothing is left of its confidence.
    let by_vote = session.conflicts.get(&frame).map_or(1.0, |conflict| {
        (1.0 - conflict.share() / (2.0 * CONFLICT_ABOVE)).max(0.0)
    });
    if mask.origin == MaskOrigin::Keyframe {
        return if by_vote < flag_below {
            FrameHeat::Confidence(by_vote)
        } else {
            FrameHeat::Confirmed
        };
    }
    if mask.stale {
        return FrameHeat::Stale;
    }
    if presence.lost_on(session.project, frame).next().is_some() {
        return FrameHeat::Confidence(0.0);
    }
    FrameHeat::Confidence(mask.confidence.values().copied().fold(by_vote, f32::min))
}

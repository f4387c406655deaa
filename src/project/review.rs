//! Which frames the user confirmed, which frames should be checked, and why.
//!
//! Window and command line count with [`review`], so that both show the same numbers. A frame is
//! never both confirmed and to check: what the user confirmed is not questioned again.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::{FrameMask, MaskOrigin, Presence, Project};
use ostra_cloud::conflicts::FrameConflict;
use ostra_masks::{LabelId, LabelTree};

/// Tracker confidence below which a frame is flagged, unless the user sets another.
pub const FLAG_BELOW: f32 = 0.5;

/// Share of compared pixels in conflict with the vote above which a frame is flagged.
///
/// The list of conflicts starts at 1 %, where borders and small parts differ. A tenth is where the
/// strip of the window shows medium confidence: a part of an object is wrong, or the vote is.
pub const CONFLICT_ABOVE: f32 = 0.1;

/// Why a frame should be checked.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(tag = "reason", rename_all = "snake_case")]
pub enum CheckReason {
    /// An input of the mask has changed since it was made.
    Stale,
    /// The tracker lost a label that the previous frame shows.
    Lost {
        /// The label.
        label: LabelId,
    },
    /// The tracker's confidence in a label is below the limit.
    LowConfidence {
        /// The label.
        label: LabelId,
        /// Confidence that the tracker reports, 0–1. It is no measured accuracy.
        confidence: f32,
    },
    /// The mask disagrees with the vote of all views.
    Conflict {
        /// Share of the compared pixels that disagree, 0–1.
        share: f32,
    },
}

impl CheckReason {
    /// Describes the reason with the names of the labels.
    #[must_use]
    pub fn text(&self, labels: &LabelTree) -> String {
        let name = |label: LabelId| labels.get(label).map_or("?", |label| label.name.as_str());
        match *self {
            Self::Stale => "stale: made from inputs that changed since".into(),
            Self::Lost { label } => {
                format!("{} is lost: only the frame before shows it", name(label))
            }
            Self::LowConfidence { label, confidence } => format!(
                "{}: tracker confidence {:.0} %",
                name(label),
                100.0 * confidence
            ),
            Self::Conflict { share } => {
                format!("{:.0} % in conflict with the 3-D vote", 100.0 * share)
            }
        }
    }
}

/// What frames are checked against.
#[derive(Debug, Clone, Copy)]
pub struct ReviewCriteria<'a> {
    /// Tracker confidence below which a frame is flagged, 0–1.
    pub flag_below: f32,
    /// Conflict of each frame's mask with the vote; empty if no vote is known.
    pub conflicts: &'a BTreeMap<usize, FrameConflict>,
}

/// Number of confirmed frames, and the frames to check.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Review {
    /// Number of frames of the project.
    pub frames: usize,
    /// Number of keyframes: the user gave or confirmed their masks.
    pub confirmed: usize,
    /// Frames to check with the reasons, none of which is empty.
    pub to_check: BTreeMap<usize, Vec<CheckReason>>,
}

impl Review {
    /// Returns the next frame to check, wrapping around after the last one.
    ///
    /// Returns `None` if no frame is to check, or only the given one.
    #[must_use]
    pub fn next_after(&self, frame: usize) -> Option<usize> {
        let later = self.to_check.range(frame + 1..).next();
        let next = later.or_else(|| self.to_check.range(..frame).next());
        next.map(|(&next, _)| next)
    }

    /// Returns the number of confirmed frames as text.
    #[must_use]
    pub fn confirmed_text(&self) -> String {
        let noun = if self.frames == 1 { "frame" } else { "frames" };
        format!("{} of {} {noun} confirmed", self.confirmed, self.frames)
    }

    /// Returns the number of frames to check as text.
    #[must_use]
    pub fn to_check_text(&self) -> String {
        format!("{} to check", self.to_check.len())
    }
}

/// Counts the confirmed frames and lists the frames to check.
///
/// Only tracked masks are to be checked. `presence` holds the labels on the frames of `project`.
#[must_use]
pub fn review(project: &Project, presence: &Presence, criteria: ReviewCriteria<'_>) -> Review {
    let mut review = Review {
        frames: project.frames.len(),
        ..Review::default()
    };
    for (&frame, mask) in &project.masks {
        if mask.origin == MaskOrigin::Keyframe {
            review.confirmed += 1;
            continue;
        }
        let reasons = reasons(project, presence, criteria, frame, mask);
        if !reasons.is_empty() {
            review.to_check.insert(frame, reasons);
        }
    }
    review
}

fn reasons(
    project: &Project,
    presence: &Presence,
    criteria: ReviewCriteria<'_>,
    frame: usize,
    mask: &FrameMask,
) -> Vec<CheckReason> {
    let stale = mask.stale.then_some(CheckReason::Stale);
    let lost = presence
        .lost_on(project, frame)
        .map(|label| CheckReason::Lost { label });
    let unsure = mask
        .confidence
        .iter()
        .filter(|&(_, &confidence)| confidence < criteria.flag_below)
        .map(|(&label, &confidence)| CheckReason::LowConfidence { label, confidence });
    let share = criteria
        .conflicts
        .get(&frame)
        .map_or(0.0, FrameConflict::share);
    let conflict = (share > CONFLICT_ABOVE).then_some(CheckReason::Conflict { share });
    stale
        .into_iter()
        .chain(lost)
        .chain(unsure)
        .chain(conflict)
        .collect()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::Marks;
    use crate::testing::{frame, keyframe, label, mask, tracked};
    use ostra_frames::FrameSet;

    const LEAF: LabelId = LabelId(1);

    fn project(masks: impl IntoIterator<Item = (usize, FrameMask)>) -> Project {
        let frames = (0..6).map(|number| frame(&format!("{number}.png")));
        let mut project = Project {
            frames: Arc::new(frames.collect()),
            masks: masks.into_iter().collect(),
            ..Project::default()
        };
        project.labels.set(label(1, "leaf")).unwrap();
        project
    }

    fn checked(project: &Project, conflicts: &BTreeMap<usize, FrameConflict>) -> Review {
        let criteria = ReviewCriteria {
            flag_below: FLAG_BELOW,
            conflicts,
        };
        review(project, &Presence::of(project), criteria)
    }

    fn conflict(against: usize) -> FrameConflict {
        FrameConflict {
            compared: 100,
            against,
        }
    }

    #[test]
    fn every_reason_flags_its_frame_and_says_why() {
        let stale = mask([1, 0, 0], MaskOrigin::Tracked, true);
        let unsure = FrameMask {
            confidence: BTreeMap::from([(LEAF, 0.2)]),
            ..tracked([1, 0, 0])
        };
        let project = project([
            (0, keyframe([1, 0, 0])),
            (1, tracked([1, 0, 0])),
            (2, stale),
            (3, unsure),
            (4, mask([0; 3], MaskOrigin::Tracked, false)),
            (5, tracked([1, 0, 0])),
        ]);
        let conflicts = BTreeMap::from([(1, conflict(10)), (5, conflict(30))]);
        let review = checked(&project, &conflicts);
        assert_eq!((review.frames, review.confirmed), (6, 1));
        let texts: Vec<(usize, String)> = review
            .to_check
            .iter()
            .map(|(&frame, reasons)| (frame, reasons[0].text(&project.labels)))
            .collect();
        assert_eq!(
            texts,
            [
                (2, "stale: made from inputs that changed since".into()),
                (3, "leaf: tracker confidence 20 %".into()),
                (4, "leaf is lost: only the frame before shows it".into()),
                (5, "30 % in conflict with the 3-D vote".into()),
            ]
        );
        assert_eq!(review.confirmed_text(), "1 of 6 frames confirmed");
        assert_eq!(review.to_check_text(), "4 to check");
    }

    #[test]
    fn confirmed_and_absent_are_not_questioned() {
        let mut project = project([
            (0, keyframe([1, 0, 0])),
            (1, mask([0; 3], MaskOrigin::Tracked, false)),
            (2, keyframe([1, 0, 0])),
        ]);
        let conflicts = BTreeMap::from([(0, conflict(90))]);
        assert_eq!(checked(&project, &conflicts).to_check.len(), 1, "lost on 1");
        let absent = Marks {
            absent: FrameSet::from(vec![(1, 1)]),
            ..Marks::default()
        };
        project.marks.insert(LEAF, absent);
        let review = checked(&project, &conflicts);
        assert_eq!((review.confirmed, review.to_check.len()), (2, 0));
        assert_eq!(review.next_after(0), None);
    }

    #[test]
    fn next_frame_wraps_around_and_skips_the_present_one() {
        let stale = || mask([1, 0, 0], MaskOrigin::Tracked, true);
        let project = project([(1, stale()), (4, stale())]);
        let review = checked(&project, &BTreeMap::new());
        let next = [0, 1, 2, 4, 5].map(|frame| review.next_after(frame));
        assert_eq!(next, [Some(1), Some(4), Some(4), Some(1), Some(1)]);
        let mut alone = review.clone();
        alone.to_check.remove(&4);
        assert_eq!(alone.next_after(1), None);
    }
}

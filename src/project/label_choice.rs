use std::collections::BTreeSet;
use std::sync::Arc;

use crate::{Edit, FrameMask, MaskOrigin, Project};
use ostra_masks::{LabelId, RunMask, transfer};

/// The labels of a tracker's result that a project takes: all, or some of them.
///
/// The other labels stay unchanged.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct LabelChoice {
    labels: Option<BTreeSet<LabelId>>,
    replace: bool,
}

impl LabelChoice {
    /// Chooses these labels, or all if the list is empty.
    ///
    /// With `replace`, they are written over other labels too.
    #[must_use]
    pub fn new(labels: &[LabelId], replace: bool) -> Self {
        let labels: BTreeSet<LabelId> = labels.iter().copied().collect();
        Self {
            labels: (!labels.is_empty()).then_some(labels),
            replace,
        }
    }

    /// Returns the chosen labels; `None` means all.
    #[must_use]
    pub fn labels(&self) -> Option<&BTreeSet<LabelId>> {
        self.labels.as_ref()
    }

    /// Returns the edit that gives a frame the tracker's result.
    ///
    /// Returns `None` for a keyframe, which no tracker overwrites, and if the frame or a label no
    /// longer exists.
    #[must_use]
    pub fn edit(&self, project: &Project, frame: usize, answer: FrameMask) -> Option<Edit> {
        let before = project.masks.get(&frame);
        let is_keyframe = before.is_some_and(|mask| mask.origin == MaskOrigin::Keyframe);
        let size = (answer.runs.width, answer.runs.height);
        let fits = project
            .frames
            .get(frame)
            .is_some_and(|of| (of.width, of.height) == size);
        if is_keyframe || !fits {
            return None;
        }
        let mask = match &self.labels {
            Some(labels) => {
                let barred = &project.absent_on(frame) | &project.locked_on(frame);
                self.chosen_part(&(labels - &barred), before, &answer)?
            }
            None => answer,
        };
        let mask = project.within_marks(frame, mask);
        let known = |id| id == LabelId::NONE || project.labels.get(id).is_some();
        let known = mask.runs.runs.iter().all(|&(id, _)| known(id));
        known.then_some(Edit::SetMask {
            frame,
            mask: Some(mask),
        })
    }

    /// Returns the frame's mask with the chosen labels taken from the result.
    ///
    /// This applies to the labels' pixels and confidences. Everything else is as before.
    fn chosen_part(
        &self,
        labels: &BTreeSet<LabelId>,
        before: Option<&FrameMask>,
        answer: &FrameMask,
    ) -> Option<FrameMask> {
        let nothing = || Arc::new(RunMask::empty(answer.runs.width, answer.runs.height));
        let present = before.map_or_else(nothing, |mask| Arc::clone(&mask.runs));
        let moved = transfer(&present, &answer.runs, labels, self.replace).ok()?;
        let runs = if moved == *present {
            present
        } else {
            Arc::new(moved)
        };
        let kept = before
            .into_iter()
            .flat_map(|mask| &mask.confidence)
            .filter(|(id, _)| !labels.contains(id));
        let new = answer
            .confidence
            .iter()
            .filter(|(id, _)| labels.contains(id));
        let confidence = kept
            .chain(new)
            .map(|(&id, &confidence)| (id, confidence))
            .collect();
        Some(FrameMask {
            runs,
            confidence,
            origin: answer.origin,
            stale: answer.stale,
        })
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::testing::{keyframe, project, tracked};

    fn choice(labels: &[u16], replace: bool) -> LabelChoice {
        let labels: Vec<LabelId> = labels.iter().copied().map(LabelId).collect();
        LabelChoice::new(&labels, replace)
    }

    /// Returns a project with labels 1 and 2 on frame 0, a keyframe on frame 1, and no other masks.
    fn begun() -> Project {
        let mut project = project();
        let confidence = BTreeMap::from([(LabelId(1), 0.5), (LabelId(2), 0.25)]);
        let both = FrameMask {
            confidence,
            stale: true,
            ..tracked([1, 2, 0])
        };
        for (frame, mask) in [(0, both), (1, keyframe([1, 2, 0]))] {
            project
                .apply(Edit::SetMask {
                    frame,
                    mask: Some(mask),
                })
                .unwrap();
        }
        project
    }

    fn taken(choice: &LabelChoice, frame: usize, ids: [u16; 3]) -> Option<FrameMask> {
        match choice.edit(&begun(), frame, tracked(ids)) {
            Some(Edit::SetMask { mask, .. }) => mask,
            _ => None,
        }
    }

    #[test]
    fn other_labels_keep_their_pixels_and_confidence() {
        let mask = taken(&choice(&[1], false), 0, [0, 1, 1]).unwrap();
        assert_eq!(mask.runs, tracked([0, 2, 1]).runs);
        assert_eq!(
            mask.confidence,
            BTreeMap::from([(LabelId(1), 0.7), (LabelId(2), 0.25)])
        );
        assert!(!mask.stale, "a mask that is tracked again is not stale");
        assert_eq!(
            taken(&choice(&[1], true), 0, [0, 1, 1]).unwrap().runs,
            tracked([0, 1, 1]).runs
        );
        assert_eq!(
            taken(&choice(&[], false), 0, [0, 1, 1]),
            Some(tracked([0, 1, 1])),
            "all labels"
        );
    }

    #[test]
    fn frame_without_a_mask_gets_only_the_chosen_labels() {
        assert_eq!(
            taken(&choice(&[1], false), 2, [2, 1, 2]).unwrap().runs,
            tracked([0, 1, 0]).runs
        );
    }

    #[test]
    fn keyframes_and_removed_labels_are_not_changed() {
        assert_eq!(taken(&choice(&[1], true), 1, [1, 1, 1]), None);
        assert_eq!(taken(&choice(&[], true), 1, [1, 1, 1]), None);
        assert_eq!(taken(&choice(&[7], true), 0, [7, 7, 7]), None);
        assert!(
            taken(&choice(&[1], true), 0, [7, 1, 1]).is_some(),
            "a label that is not taken need not be known"
        );
    }
}

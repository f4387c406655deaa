use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use crate::{Edit, FrameMask, Marks, Project};
use ostra_masks::{LabelId, RunMask, hold};

impl Project {
    /// Returns the marks of a label.
    #[must_use]
    pub fn marks_of(&self, label: LabelId) -> Marks {
        self.marks.get(&label).cloned().unwrap_or_default()
    }

    /// Returns the labels whose pixels on a frame are locked.
    #[must_use]
    pub fn locked_on(&self, frame: usize) -> BTreeSet<LabelId> {
        self.marked(|marks| marks.locked.contains(frame))
    }

    /// Returns the labels that trackers may not put on a frame.
    #[must_use]
    pub fn absent_on(&self, frame: usize) -> BTreeSet<LabelId> {
        self.marked(|marks| marks.absent.contains(frame))
    }

    /// Returns a frame's mask without the labels that are hidden there.
    ///
    /// This is the mask that is drawn, voted and exported.
    #[must_use]
    pub fn mask_in_play(&self, frame: usize) -> Option<Arc<RunMask>> {
        Some(self.in_play(frame, &self.masks.get(&frame)?.runs))
    }

    /// Returns `runs` without the labels that are hidden on a frame.
    #[must_use]
    pub fn in_play(&self, frame: usize, runs: &Arc<RunMask>) -> Arc<RunMask> {
        let hidden = self.marked(|marks| marks.hidden.contains(frame));
        let shown = |id: LabelId| {
            if hidden.contains(&id) {
                LabelId::NONE
            } else {
                id
            }
        };
        if hidden.is_empty() {
            Arc::clone(runs)
        } else {
            Arc::new(runs.map_ids(shown))
        }
    }

    /// Returns all masks without their hidden labels, by frame.
    pub fn masks_in_play(&self) -> impl Iterator<Item = (usize, Arc<RunMask>)> + '_ {
        self.masks
            .keys()
            .filter_map(|&frame| Some((frame, self.mask_in_play(frame)?)))
    }

    /// Returns `runs` with the locked labels' pixels exactly as they are on the frame now.
    #[must_use]
    pub fn with_locks(&self, frame: usize, runs: Arc<RunMask>) -> Arc<RunMask> {
        let locked = self.locked_on(frame);
        if locked.is_empty() {
            return runs;
        }
        let empty = || Arc::new(RunMask::empty(runs.width, runs.height));
        let before = self
            .masks
            .get(&frame)
            .map_or_else(empty, |mask| Arc::clone(&mask.runs));
        hold(&before, &runs, &locked).map_or(before, Arc::new)
    }

    /// Returns the part of a tracker's result that a frame may take.
    ///
    /// Labels marked as absent are removed, and locked labels keep their pixels.
    #[must_use]
    pub fn within_marks(&self, frame: usize, answer: FrameMask) -> FrameMask {
        let (absent, locked) = (self.absent_on(frame), self.locked_on(frame));
        if absent.is_empty() && locked.is_empty() {
            return answer;
        }
        let there = |id: LabelId| {
            if absent.contains(&id) {
                LabelId::NONE
            } else {
                id
            }
        };
        let runs = self.with_locks(frame, Arc::new(answer.runs.map_ids(there)));
        let mut confidence = answer.confidence;
        confidence.retain(|id, _| !absent.contains(id) && !locked.contains(id));
        let before = self
            .masks
            .get(&frame)
            .into_iter()
            .flat_map(|mask| &mask.confidence);
        confidence.extend(
            before
                .filter(|(id, _)| locked.contains(id))
                .map(|(&id, &confidence)| (id, confidence)),
        );
        FrameMask {
            runs,
            confidence,
            ..answer
        }
    }

    /// Returns the edits that clear absent marks where `edits` set masks that show the labels.
    #[must_use]
    pub fn there_again(&self, edits: &[Edit]) -> Vec<Edit> {
        let mut changed: BTreeMap<LabelId, Marks> = BTreeMap::new();
        for edit in edits {
            let Edit::SetMask {
                frame,
                mask: Some(mask),
            } = edit
            else {
                continue;
            };
            let shown = |label: &LabelId| mask.runs.runs.iter().any(|(id, _)| id == label);
            for label in self.absent_on(*frame).into_iter().filter(shown) {
                changed
                    .entry(label)
                    .or_insert_with(|| self.marks_of(label))
                    .absent
                    .remove(*frame, *frame);
            }
        }
        changed
            .into_iter()
            .map(|(label, marks)| Edit::SetMarks { label, marks })
            .collect()
    }

    fn marked(&self, is: impl Fn(&Marks) -> bool) -> BTreeSet<LabelId> {
        self.marks
            .iter()
            .filter(|(_, marks)| is(marks))
            .map(|(&label, _)| label)
            .collect()
    }
}

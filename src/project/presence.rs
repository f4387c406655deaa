use std::collections::BTreeMap;
use std::sync::Arc;

use ostra_masks::{LabelId, RunMask};

use crate::{MaskOrigin, Project};

/// Labels present on each frame. Only masks that changed are scanned again.
#[derive(Debug, Default)]
pub struct Presence {
    frames: BTreeMap<usize, (Arc<RunMask>, Vec<LabelId>)>,
    counts: BTreeMap<LabelId, usize>,
}

impl Presence {
    /// Returns the labels on the frames of a project.
    #[must_use]
    pub fn of(project: &Project) -> Self {
        let mut presence = Self::default();
        presence.update(project);
        presence
    }

    /// Updates the index from the project; cheap if no mask changed.
    pub fn update(&mut self, project: &Project) {
        let mut changed = self.frames.len() != project.masks.len();
        self.frames
            .retain(|frame, _| project.masks.contains_key(frame));
        for (&frame, mask) in &project.masks {
            if self
                .frames
                .get(&frame)
                .is_none_or(|(runs, _)| !Arc::ptr_eq(runs, &mask.runs))
            {
                self.frames
                    .insert(frame, (Arc::clone(&mask.runs), labels_in(&mask.runs)));
                changed = true;
            }
        }
        if changed {
            self.count();
        }
    }

    /// Returns the labels on a frame, ordered by id.
    #[must_use]
    pub fn on_frame(&self, frame: usize) -> &[LabelId] {
        self.frames.get(&frame).map_or(&[], |(_, labels)| labels)
    }

    /// Returns the number of frames with a label.
    #[must_use]
    pub fn frames_with(&self, label: LabelId) -> usize {
        self.counts.get(&label).copied().unwrap_or(0)
    }

    /// Returns labels of the previous frame that the tracker lost on `frame`.
    ///
    /// Labels that the user marked as absent are left out.
    pub fn lost_on<'a>(
        &'a self,
        project: &'a Project,
        frame: usize,
    ) -> impl Iterator<Item = LabelId> + 'a {
        let is_tracked = project
            .masks
            .get(&frame)
            .is_some_and(|mask| mask.origin == MaskOrigin::Tracked);
        let before = frame
            .checked_sub(1)
            .filter(|_| is_tracked)
            .map_or(&[][..], |before| self.on_frame(before));
        let now = self.on_frame(frame);
        let is_absent = move |label: &LabelId| {
            let marks = project.marks.get(label);
            marks.is_some_and(|marks| marks.absent.contains(frame))
        };
        before
            .iter()
            .copied()
            .filter(move |label| !now.contains(label) && !is_absent(label))
    }

    fn count(&mut self) {
        self.counts.clear();
        for label in self.frames.values().flat_map(|(_, labels)| labels) {
            *self.counts.entry(*label).or_default() += 1;
        }
    }
}

/// Returns the labels of a mask, ordered by id.
fn labels_in(mask: &RunMask) -> Vec<LabelId> {
    let mut ids: Vec<LabelId> = Vec::new();
    for &(id, _) in &mask.runs {
        // A mask has many runs and few labels.
        if id != LabelId::NONE && !ids.contains(&id) {
            ids.push(id);
        }
    }
    ids.sort_unstable();
    ids
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::FrameMask;
    use crate::testing::keyframe;

    fn mask(ids: &[u16]) -> FrameMask {
        let runs = ids.iter().map(|&id| (LabelId(id), 1)).collect();
        let runs = Arc::new(RunMask {
            width: ids.len() as u32,
            height: 1,
            runs,
        });
        FrameMask {
            runs,
            ..keyframe([0; 3])
        }
    }

    #[test]
    fn frame_counts_follow_mask_changes() {
        let (mut project, mut presence) = (Project::default(), Presence::default());
        project.masks.insert(0, mask(&[0, 2, 0, 1, 2]));
        project.masks.insert(4, mask(&[2]));
        presence.update(&project);
        assert_eq!(presence.on_frame(0), [LabelId(1), LabelId(2)]);
        assert_eq!(
            (
                presence.frames_with(LabelId(2)),
                presence.frames_with(LabelId(1))
            ),
            (2, 1)
        );
        project.masks.insert(4, mask(&[1]));
        project.masks.remove(&0);
        presence.update(&project);
        assert_eq!(
            (
                presence.frames_with(LabelId(2)),
                presence.frames_with(LabelId(1))
            ),
            (0, 1)
        );
    }
}

use std::collections::BTreeMap;
use std::sync::Arc;

use ostra_masks::{LabelId, RunMask};
use ostra_project::Project;

/// Which labels are on which frames, worked out anew only for masks that changed.
#[derive(Default)]
pub struct Presence {
    frames: BTreeMap<usize, (Arc<RunMask>, Vec<LabelId>)>,
    counts: BTreeMap<LabelId, usize>,
}

impl Presence {
    /// Follows the project; cheap while no mask changed.
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

    /// The labels on a frame, ordered by id.
    #[must_use]
    pub fn on_frame(&self, frame: usize) -> &[LabelId] {
        self.frames.get(&frame).map_or(&[], |(_, labels)| labels)
    }

    /// On how many frames a label is.
    #[must_use]
    pub fn frames_with(&self, label: LabelId) -> usize {
        self.counts.get(&label).copied().unwrap_or(0)
    }

    fn count(&mut self) {
        self.counts.clear();
        for label in self.frames.values().flat_map(|(_, labels)| labels) {
            *self.counts.entry(*label).or_default() += 1;
        }
    }
}

fn labels_in(mask: &RunMask) -> Vec<LabelId> {
    let mut ids: Vec<LabelId> = mask
        .runs
        .iter()
        .map(|run| run.0)
        .filter(|&id| id != LabelId::NONE)
        .collect();
    ids.sort_unstable();
    ids.dedup();
    ids
}

#[cfg(test)]
mod tests {
    use super::*;
    use ostra_project::{FrameMask, MaskOrigin};

    fn mask(ids: &[u16]) -> FrameMask {
        let runs = ids.iter().map(|&id| (LabelId(id), 1)).collect();
        let runs = Arc::new(RunMask {
            width: ids.len() as u32,
            height: 1,
            runs,
        });
        FrameMask {
            runs,
            origin: MaskOrigin::Anchor,
            stale: false,
            confidence: BTreeMap::new(),
        }
    }

    #[test]
    fn counts_follow_changes() {
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

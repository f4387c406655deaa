//! State of the panels that persists between draws: typed text and cached counts.

use ostra_project::GrounderId;
use std::collections::BTreeMap;
use std::sync::Arc;

use ostra_cloud::LabelledCloud;
use ostra_masks::{LabelId, LabelTree, RunMask};
use ostra_project::Project;
use ostra_session::{Command, FindByTextRequest};

/// Labels present on each frame. Only masks that changed are scanned again.
#[derive(Default)]
pub struct Presence {
    frames: BTreeMap<usize, (Arc<RunMask>, Vec<LabelId>)>,
    counts: BTreeMap<LabelId, usize>,
}

impl Presence {
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

/// Score threshold of the search. A higher threshold on the slider only filters its results.
pub(super) const MIN_SHOWN_SCORE: f32 = 0.1;

/// Text to search for, and the score required of a result.
#[derive(Debug, Clone, PartialEq)]
pub struct TextPrompt {
    pub(super) text: String,
    /// Minimum score of a shown result, 0–1.
    pub least: f32,
}

impl Default for TextPrompt {
    fn default() -> Self {
        Self {
            text: String::new(),
            least: 0.3,
        }
    }
}

impl TextPrompt {
    /// Returns the command that searches a frame; phrases are separated by `;` or `,`.
    pub(super) fn request(&self, frame: usize) -> Option<Command> {
        let phrases = self
            .text
            .split([';', ','])
            .map(|phrase| phrase.trim().to_owned());
        let phrases: Vec<String> = phrases.filter(|phrase| !phrase.is_empty()).collect();
        let request = FindByTextRequest {
            frame,
            phrases,
            threshold: Some(MIN_SHOWN_SCORE),
            grounder: GrounderId::Auto,
        };
        (!request.phrases.is_empty()).then_some(Command::Ground(request))
    }
}

/// Points per label, counted once per cloud.
#[derive(Default)]
pub struct PointCounts {
    cloud: Option<Arc<LabelledCloud>>,
    counts: BTreeMap<LabelId, usize>,
}

impl PointCounts {
    /// Returns the number of points with a label or one of its descendants.
    pub(super) fn below(
        &mut self,
        cloud: &Arc<LabelledCloud>,
        tree: &LabelTree,
        id: LabelId,
    ) -> usize {
        let counts = self.of(cloud);
        let of = |id: &LabelId| counts.get(id).copied().unwrap_or(0);
        of(&id) + tree.descendants(id).iter().map(of).sum::<usize>()
    }

    pub(super) fn of(&mut self, cloud: &Arc<LabelledCloud>) -> &BTreeMap<LabelId, usize> {
        if !self
            .cloud
            .as_ref()
            .is_some_and(|counted| Arc::ptr_eq(counted, cloud))
        {
            // One counter for every possible id: five million points are counted in milliseconds.
            let mut counters = vec![0; usize::from(u16::MAX) + 1];
            cloud
                .labels
                .iter()
                .for_each(|label| counters[usize::from(label.0)] += 1);
            let seen = counters
                .into_iter()
                .zip(0..=u16::MAX)
                .filter(|(count, _)| *count > 0);
            self.counts = seen.map(|(count, id)| (LabelId(id), count)).collect();
            self.cloud = Some(Arc::clone(cloud));
        }
        &self.counts
    }
}

/// Text being typed in the label list.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LabelEditing {
    pub(super) renaming: Option<(LabelId, String)>,
    pub(super) focus: bool,
    pub(super) new_name: String,
    pub(super) parent: Option<LabelId>,
    /// Text that the names of listed labels contain.
    pub(super) filter: String,
    /// Whether the list scrolls to the selected label on its next draw.
    pub(super) reveal: bool,
    /// Selected label, and the one selected before it.
    selected: [Option<LabelId>; 2],
}

impl LabelEditing {
    /// Starts renaming a label.
    pub fn rename(&mut self, label: LabelId, name: &str) {
        self.renaming = Some((label, name.into()));
        self.focus = true;
    }

    /// Remembers which label was selected before the current one.
    pub(super) fn follow(&mut self, selected: Option<LabelId>) {
        if self.selected[0] != selected {
            self.selected = [selected, self.selected[0]];
            self.reveal = true;
        }
    }

    /// Returns the label that was selected before the current one, if it still exists.
    pub(super) fn previous(&self, tree: &LabelTree) -> Option<LabelId> {
        self.selected[1].filter(|&label| tree.get(label).is_some())
    }
}

/// State of the cameras and matches window.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct MatchView {
    /// Whether the window is open.
    pub open: bool,
    /// Second frame to show; `None` selects the one with the strongest link to the shown frame.
    pub other: Option<usize>,
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
            origin: MaskOrigin::Keyframe,
            stale: false,
            confidence: BTreeMap::new(),
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

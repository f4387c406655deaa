//! State of the panels that persists between draws: typed text and cached counts.

use ostra_project::GrounderId;
use std::collections::BTreeMap;
use std::sync::Arc;

use ostra_cloud::LabelledCloud;
use ostra_masks::{LabelId, LabelTree};
use ostra_session::{Command, FindByTextRequest};

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

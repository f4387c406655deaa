use std::cell::Cell;
use std::collections::BTreeMap;
use std::sync::{Arc, Weak};

use ostra_cloud::fuse::Votes;
use ostra_core::job::JobId;
use ostra_masks::{LabelId, RunMask};
use ostra_project::Project;
use ostra_project::voted_cloud::{VotedCloud, is_stale};

/// State of the live relabelling of the cloud in memory.
///
/// This is not a query, because the result replaces the cloud from which it was made.
#[derive(Default)]
pub(crate) struct LiveRevote {
    pub(crate) is_wanted: Cell<bool>,
    pub(crate) job: Option<JobId>,
    /// Inputs of the labels of the cloud in memory.
    pub(crate) counted: Option<VoteInputs>,
    /// Revision of the project and the votes that were last examined.
    seen: Option<(u64, Weak<Votes>)>,
}

/// The inputs from which votes are counted.
#[derive(Clone)]
pub(crate) struct VoteInputs {
    votes: Weak<Votes>,
    parents: Vec<(LabelId, Option<LabelId>)>,
    /// Masks of the voting frames by frame number; frames without a mask are missing.
    masks: BTreeMap<usize, Arc<RunMask>>,
}

/// Frames whose votes have changed.
pub(crate) struct ChangedVoters {
    pub(crate) inputs: VoteInputs,
    pub(crate) frames: Vec<usize>,
}

impl VoteInputs {
    /// Returns the inputs for the current masks and labels.
    fn now(project: &Project, votes: &Arc<Votes>) -> Self {
        let masks = votes
            .frames()
            .filter_map(|frame| Some((frame, project.mask_in_play(frame)?)))
            .collect();
        let parents = project
            .labels
            .iter()
            .map(|label| (label.id, label.parent))
            .collect();
        Self {
            votes: Arc::downgrade(votes),
            parents,
            masks,
        }
    }

    /// Returns the same masks as inputs of other votes.
    pub(crate) fn counted_in(self, votes: &Arc<Votes>) -> Self {
        Self {
            votes: Arc::downgrade(votes),
            ..self
        }
    }

    /// Returns the voters whose masks differ between these inputs and the current ones.
    fn changed(&self, now: &Self, voters: impl Iterator<Item = usize>) -> Vec<usize> {
        let differs = |frame: &usize| match (self.masks.get(frame), now.masks.get(frame)) {
            (Some(before), Some(mask)) => !Arc::ptr_eq(before, mask) && before != mask,
            (before, mask) => before.is_some() || mask.is_some(),
        };
        voters.filter(differs).collect()
    }
}

impl LiveRevote {
    /// Returns whether the labels of the cloud with these votes are those of the current masks.
    pub(crate) fn is_up_to_date(&self, project: &Project, votes: &Arc<Votes>) -> bool {
        self.counted.as_ref().is_some_and(|counted| {
            let now = VoteInputs::now(project, votes);
            counted.votes.ptr_eq(&now.votes)
                && counted.parents == now.parents
                && counted.changed(&now, votes.frames()).is_empty()
        })
    }

    /// Returns the frames of a cloud that have to vote again.
    ///
    /// Returns `None` if its labels are up to date or the frames that voted are unknown. Each
    /// revision of the project is examined only once.
    pub(crate) fn changed_voters(
        &mut self,
        project: &Project,
        revision: u64,
        voted: &VotedCloud,
    ) -> Option<ChangedVoters> {
        let votes = &voted.votes;
        let seen = (revision, Arc::downgrade(votes));
        let is_seen = |(of, votes): &(u64, Weak<Votes>)| *of == seen.0 && votes.ptr_eq(&seen.1);
        if !voted.can_revote() || self.seen.as_ref().is_some_and(is_seen) {
            return None;
        }
        self.seen = Some(seen);
        let now = VoteInputs::now(project, votes);
        let before = self
            .counted
            .as_ref()
            .filter(|counted| counted.votes.ptr_eq(&now.votes));
        let frames = match before {
            Some(before) => {
                let changed = before.changed(&now, votes.frames());
                if changed.is_empty() && before.parents == now.parents {
                    return None;
                }
                changed
            }
            None if is_stale(project) => votes.frames().collect(),
            None => {
                // A cloud that was just made or loaded has the labels of the current masks.
                self.counted = Some(now);
                return None;
            }
        };
        Some(ChangedVoters {
            inputs: now,
            frames,
        })
    }
}

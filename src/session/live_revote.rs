use std::cell::Cell;
use std::collections::BTreeMap;
use std::sync::{Arc, Weak};

use ostra_cloud::fuse::Votes;
use ostra_core::job::JobId;
use ostra_masks::{LabelId, RunMask};
use ostra_project::Project;
use ostra_project::voted_cloud::{VotedCloud, is_stale};

/// Whether the cloud in memory follows the masks, and what it is labelled by. Not a query: what the job makes takes the
/// place of the cloud that it was made of.
#[derive(Default)]
pub(crate) struct LiveRevote {
    pub(crate) is_wanted: Cell<bool>,
    pub(crate) job: Option<JobId>,
    /// What the cloud in memory is labelled by.
    pub(crate) counted: Option<VoteInputs>,
    /// The revision of the project and the votes that were last looked at.
    seen: Option<(u64, Weak<Votes>)>,
}

/// What votes are counted of.
#[derive(Clone)]
pub(crate) struct VoteInputs {
    votes: Weak<Votes>,
    parents: Vec<(LabelId, Option<LabelId>)>,
    /// By frame number, those of voters that have one.
    masks: BTreeMap<usize, Arc<RunMask>>,
}

/// Frames that vote differently now.
pub(crate) struct ChangedVoters {
    pub(crate) inputs: VoteInputs,
    pub(crate) frames: Vec<usize>,
}

impl VoteInputs {
    /// What the frames would vote by now.
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

    /// The same masks, counted in other votes.
    pub(crate) fn counted_in(self, votes: &Arc<Votes>) -> Self {
        Self {
            votes: Arc::downgrade(votes),
            ..self
        }
    }

    /// The voters whose masks differ from these.
    fn changed(&self, now: &Self, voters: impl Iterator<Item = usize>) -> Vec<usize> {
        let differs = |frame: &usize| match (self.masks.get(frame), now.masks.get(frame)) {
            (Some(before), Some(mask)) => !Arc::ptr_eq(before, mask) && before != mask,
            (before, mask) => before.is_some() || mask.is_some(),
        };
        voters.filter(differs).collect()
    }
}

impl LiveRevote {
    /// Whether the labels of the cloud with these votes are those of the masks now.
    pub(crate) fn is_up_to_date(&self, project: &Project, votes: &Arc<Votes>) -> bool {
        self.counted.as_ref().is_some_and(|counted| {
            let now = VoteInputs::now(project, votes);
            counted.votes.ptr_eq(&now.votes)
                && counted.parents == now.parents
                && counted.changed(&now, votes.frames()).is_empty()
        })
    }

    /// The frames that have to vote again in a cloud; `None` where its labels are up to date, or it is not known who voted.
    /// Each revision of the project is looked at once.
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
                // What was just made or loaded is labelled by the masks of now.
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

use std::cell::Cell;
use std::collections::BTreeMap;
use std::sync::{Arc, Weak};

use super::jobs::{Kind, Landing};
use super::store::version_in_force;
use super::{Event, JobId, Project, ResultKind, Session};
use crate::engine::job::Progress;
use crate::frames::FrameStore;
use crate::masks::{LabelId, RunMask};
use crate::scene::fuse::{ChangedMask, ProjectViews, Votes, relabel, vote_again};
use crate::scene::{LabelledCloud, SceneError};

/// Frames that vote again with all of their masks decoded at once; of more, one mask is read after the other.
const FEW: usize = 8;

/// Whether the cloud in memory follows the masks, and what it is labelled by.
#[derive(Default)]
pub(super) struct Following {
    wanted: Cell<bool>,
    heard: Option<Heard>,
    job: Option<JobId>,
}

/// What votes were counted of.
#[derive(Clone)]
struct Heard {
    votes: Weak<Votes>,
    parents: Vec<(LabelId, Option<LabelId>)>,
    /// By frame number, those of voters that have one.
    masks: BTreeMap<usize, Arc<RunMask>>,
}

impl Heard {
    /// What the voters would vote by now.
    fn now(project: &Project, votes: &Arc<Votes>) -> Self {
        let masks = votes.frames().filter_map(|frame| Some((frame, project.mask_in_play(frame)?))).collect();
        let parents = project.labels.iter().map(|label| (label.id, label.parent)).collect();
        Self { votes: Arc::downgrade(votes), parents, masks }
    }

    /// The voters whose masks are others than these.
    fn changed(&self, now: &Self, voters: impl Iterator<Item = usize>) -> Vec<usize> {
        let differs = |frame: &usize| match (self.masks.get(frame), now.masks.get(frame)) {
            (Some(before), Some(mask)) => !Arc::ptr_eq(before, mask) && before != mask,
            (before, mask) => before.is_some() || mask.is_some(),
        };
        voters.filter(differs).collect()
    }
}

impl Session {
    /// Asks for labels of the project's cloud in memory ([`Self::cloud`], [`Self::votes`]) as the masks are now: after masks or
    /// the tree of labels changed, the points vote again in the background, and [`Event::CloudChanged`] tells. Points stay
    /// where they are, and files what they are until the cloud is fused. Asked once, it is done once; nothing happens while a
    /// long job runs, nor where it is not known who voted.
    pub fn follow_masks(&self) {
        self.following.wanted.set(true);
    }

    /// Starts to let those vote again who vote otherwise now.
    pub(super) fn follow_wanted(&mut self) {
        let is_voting = |id| self.jobs.iter().any(|job| job.id == id && !job.has_ended());
        let busy = self.following.job.is_some_and(is_voting) || self.check_no_long_job().is_err();
        if busy || !self.following.wanted.take() {
            return;
        }
        let Ok(project) = self.snapshot() else { return };
        let version = version_in_force(&project, ResultKind::Cloud);
        let Some((cloud, votes)) = self.cloud.in_force(version) else { return };
        if !votes.has_voters() || votes.len() != cloud.len() {
            return;
        }
        let is_stale = project.results.get(&ResultKind::Cloud).is_some_and(|record| record.stale);
        let now = Heard::now(&project, &votes);
        let before = self.following.heard.replace(now.clone()).filter(|heard| heard.votes.ptr_eq(&now.votes));
        let changed = match before {
            // What was just made or loaded is labelled by the masks of now, unless it is stale.
            None if !is_stale => return,
            None => votes.frames().collect(),
            Some(before) => {
                let changed = before.changed(&now, votes.frames());
                if changed.is_empty() && before.parents == now.parents {
                    return;
                }
                changed
            }
        };
        let store = Arc::clone(&self.store);
        self.following.job = Some(self.start("vote again", Kind::Background, move |link| {
            let (labelled, counted) = voted_again((&project, &store), (&cloud, &votes), &changed, &link.progress)?;
            let counted = Arc::new(counted);
            Ok(Box::new(move |session: &mut Self| {
                if session.cloud.revote(&votes, labelled, &counted) {
                    session.following.heard = Some(Heard { votes: Arc::downgrade(&counted), ..now });
                    session.events.push(Event::CloudChanged);
                }
                Ok(())
            }) as Landing)
        }));
    }
}

/// The cloud as the masks of the changed frames vote now.
fn voted_again(
    (project, store): (&Project, &FrameStore),
    (cloud, votes): (&LabelledCloud, &Votes),
    changed: &[usize],
    progress: &Progress,
) -> Result<(LabelledCloud, Votes), SceneError> {
    let mask = |frame: usize| project.mask_in_play(frame).map(|runs| Arc::new(runs.decode()));
    if changed.len() <= FEW {
        let changed: Vec<_> = changed.iter().map(|&frame| ChangedMask { frame, mask: mask(frame) }).collect();
        return relabel(cloud, votes, &changed, &project.labels, progress);
    }
    let views = ProjectViews { frames: &project.frames, store, masks: &mask };
    let voted = vote_again(cloud, votes, &views, &project.labels, progress)?;
    Ok((voted.cloud, voted.votes))
}

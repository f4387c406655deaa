use std::cell::Cell;
use std::collections::BTreeMap;
use std::sync::{Arc, Weak};

use super::Session;
use super::jobs::{Kind, Landing};
use crate::Event;
use ostra_cloud::fuse::{ChangedMask, ProjectViews, Votes, relabel, vote_again};
use ostra_cloud::{LabelledCloud, SceneError};
use ostra_core::job::JobId;
use ostra_core::job::Progress;
use ostra_frames::FrameStore;
use ostra_masks::{LabelId, RunMask};
use ostra_project::reusable_votes::can_revote;
use ostra_project::store::version_in_force;
use ostra_project::{Project, ResultKind};

/// Frames that vote again with all of their masks decoded at once; of more, one mask is read after the other.
const FEW: usize = 8;

/// Whether the cloud in memory follows the masks, and what it is labelled by.
#[derive(Default)]
pub(super) struct Following {
    wanted: Cell<bool>,
    heard: Option<Heard>,
    /// The revision of the project and the votes that were last looked at.
    seen: Option<(u64, Weak<Votes>)>,
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

    /// Whether the labels of the cloud in memory are those of the masks now.
    pub(super) fn follows(&self) -> bool {
        let Some(project) = self.project() else {
            return false;
        };
        let loaded = self
            .cloud
            .in_force(version_in_force(project, ResultKind::Cloud));
        let heard = self.following.heard.as_ref();
        loaded.zip(heard).is_some_and(|((_, votes), heard)| {
            let now = Heard::now(project, &votes);
            heard.votes.ptr_eq(&now.votes)
                && heard.parents == now.parents
                && heard.changed(&now, votes.frames()).is_empty()
        })
    }

    /// Starts to let those vote again who vote otherwise now.
    pub(super) fn follow_wanted(&mut self) {
        let is_voting = |id| self.jobs.iter().any(|job| job.id == id && !job.has_ended());
        let busy = self.following.job.is_some_and(is_voting) || self.check_no_long_job().is_err();
        if busy || !self.following.wanted.take() {
            return;
        }
        let Some((project, revision)) = self
            .open
            .as_ref()
            .map(|open| (Arc::clone(open.project()), open.revision()))
        else {
            return;
        };
        let version = version_in_force(&project, ResultKind::Cloud);
        let Some((cloud, votes)) = self.cloud.in_force(version) else {
            return;
        };
        let seen = (revision, Arc::downgrade(&votes));
        let is_seen = |(of, votes): &(u64, Weak<Votes>)| *of == seen.0 && votes.ptr_eq(&seen.1);
        if !can_revote(cloud.len(), &votes) || self.following.seen.as_ref().is_some_and(is_seen) {
            return;
        }
        self.following.seen = Some(seen);
        let now = Heard::now(&project, &votes);
        let before = self
            .following
            .heard
            .as_ref()
            .filter(|heard| heard.votes.ptr_eq(&now.votes));
        let changed = match before {
            Some(before) => {
                let changed = before.changed(&now, votes.frames());
                if changed.is_empty() && before.parents == now.parents {
                    return;
                }
                changed
            }
            None if is_stale(&project) => votes.frames().collect(),
            None => {
                // What was just made or loaded is labelled by the masks of now.
                self.following.heard = Some(now);
                return;
            }
        };
        self.let_vote((project, now), (cloud, votes), changed);
    }

    fn let_vote(
        &mut self,
        (project, now): (Arc<Project>, Heard),
        (cloud, votes): (Arc<LabelledCloud>, Arc<Votes>),
        changed: Vec<usize>,
    ) {
        let store = Arc::clone(&self.store);
        self.following.job = Some(self.start("vote again", Kind::Background, move |link| {
            let voted = voted_again(
                (&project, &store),
                (&cloud, &votes),
                &changed,
                &link.progress,
            )?;
            let voted = voted.map(|(labelled, counted)| (labelled, Arc::new(counted)));
            Ok(Box::new(move |session: &mut Self| {
                let Some((labelled, counted)) = voted else {
                    session.following.heard = Some(now);
                    return Ok(());
                };
                if session.cloud.revote(&votes, labelled, &counted) {
                    session.following.heard = Some(Heard {
                        votes: Arc::downgrade(&counted),
                        ..now
                    });
                    session.events.push(Event::CloudChanged);
                }
                Ok(())
            }) as Landing)
        }));
    }
}

fn is_stale(project: &Project) -> bool {
    project
        .results
        .get(&ResultKind::Cloud)
        .is_some_and(|record| record.stale)
}

/// The project's cloud with the labels of the masks now, for work that must not depend on whether a window let it follow; as
/// it is where it is not known who voted.
///
/// # Errors
/// As [`vote_again`].
pub(super) fn cloud_of_now(
    of: (&Project, &FrameStore),
    (cloud, votes): (Arc<LabelledCloud>, Arc<Votes>),
    progress: &Progress,
) -> Result<(Arc<LabelledCloud>, Arc<Votes>), SceneError> {
    if !is_stale(of.0) || !can_revote(cloud.len(), &votes) {
        return Ok((cloud, votes));
    }
    let voters: Vec<usize> = votes.frames().collect();
    let voted = voted_again(of, (&cloud, &votes), &voters, progress)?;
    Ok(voted.map_or((cloud, votes), |(cloud, votes)| {
        (Arc::new(cloud), Arc::new(votes))
    }))
}

/// The cloud as the masks of the changed frames vote now; `None` where that changes nothing.
fn voted_again(
    (project, store): (&Project, &FrameStore),
    (cloud, votes): (&LabelledCloud, &Votes),
    changed: &[usize],
    progress: &Progress,
) -> Result<Option<(LabelledCloud, Votes)>, SceneError> {
    let mask = |frame: usize| {
        project
            .mask_in_play(frame)
            .map(|runs| Arc::new(runs.decode()))
    };
    let (labelled, counted) = if changed.len() <= FEW {
        let changed: Vec<_> = changed
            .iter()
            .map(|&frame| ChangedMask {
                frame,
                mask: mask(frame),
            })
            .collect();
        relabel(cloud, votes, &changed, &project.labels, progress)?
    } else {
        let views = ProjectViews {
            frames: &project.frames,
            store,
            masks: &mask,
        };
        let voted = vote_again(cloud, votes, &views, &project.labels, progress)?;
        (voted.cloud, voted.votes)
    };
    let same = labelled.labels == cloud.labels
        && labelled.confidence == cloud.confidence
        && counted == *votes;
    Ok((!same).then_some((labelled, counted)))
}

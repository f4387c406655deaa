use std::cell::Cell;
use std::sync::Arc;

use super::Session;
use super::cloud::CloudState;
use super::commands::mask_by_vote;
use super::jobs::{Kind, Landing};
use ostra_cloud::LabelledCloud;
use ostra_cloud::doubt::contradiction;
use ostra_cloud::fuse::Votes;
use ostra_core::job::JobId;
use ostra_frames::{Frame, FrameStore};
use ostra_masks::{LabelId, Region, RunMask};
use ostra_project::Project;
use ostra_project::reusable_votes::MaskByVote;

/// Where the vote of all contradicts the mask of one frame.
#[derive(Default)]
pub(super) struct Contradicted {
    wanted: Cell<Option<usize>>,
    of: Option<Compared>,
    answer: Option<Arc<Region>>,
    job: Option<JobId>,
}

/// What the answer depends on.
#[derive(Clone)]
struct Compared {
    frame: usize,
    mask: Arc<RunMask>,
    cloud: CloudState,
    labels: Vec<LabelId>,
    frames: Arc<Vec<Frame>>,
}

impl Compared {
    /// A frame's mask as it is now, and the cloud in force; `None` where one is missing.
    fn now(project: &Project, frame: usize, cloud: CloudState) -> Option<Self> {
        let mask = project.mask_in_play(frame)?;
        let labels = project.labels.iter().map(|label| label.id).collect();
        Some(Self {
            frame,
            mask,
            cloud,
            labels,
            frames: Arc::clone(&project.frames),
        })
    }

    fn is(&self, other: &Self) -> bool {
        (self.frame, self.cloud, &self.labels) == (other.frame, other.cloud, &other.labels)
            && Arc::ptr_eq(&self.frames, &other.frames)
            && (Arc::ptr_eq(&self.mask, &other.mask) || self.mask == other.mask)
    }

    /// Where accepting the vote would give the frame other labels, those hidden on it left aside.
    fn contradiction(
        &self,
        project: &Project,
        store: &FrameStore,
        (cloud, votes): (&LabelledCloud, &Votes),
    ) -> anyhow::Result<Region> {
        let by_vote = MaskByVote {
            cloud,
            votes,
            frame: self.frame,
            labels: &[],
        };
        let voted = mask_by_vote(project, store, &by_vote)?.mask;
        let voted = Arc::new(RunMask::encode(&voted));
        let voted = project.in_play(self.frame, &project.with_locks(self.frame, voted));
        Ok(contradiction(&self.mask.decode(), &voted.decode()))
    }
}

impl Session {
    /// The pixels of a frame to which accepting the vote of all would give another label, but for borders that lie a little
    /// aside. It is worked out in the background when it is first asked for and when the mask, the cloud or the tree of labels
    /// changed, one frame at a time; by then it tells of those before. `None` until it is there.
    #[must_use]
    pub fn contradicted(&self, frame: usize) -> Option<&Arc<Region>> {
        self.contradicted.wanted.set(Some(frame));
        let same = self
            .contradicted
            .of
            .as_ref()
            .is_some_and(|of| of.frame == frame);
        self.contradicted.answer.as_ref().filter(|_| same)
    }

    /// Starts to look for what was asked for, unless something else is being looked for.
    pub(super) fn contradict_wanted(&mut self) {
        let is_comparing = |id| self.jobs.iter().any(|job| job.id == id && !job.has_ended());
        if self.contradicted.job.is_some_and(is_comparing) {
            return;
        }
        let (Some(number), Ok(project)) = (self.contradicted.wanted.take(), self.snapshot()) else {
            return;
        };
        let now = self
            .cloud_state()
            .and_then(|cloud| Compared::now(&project, number, cloud));
        let Some(now) = now else {
            self.contradicted = Contradicted::default();
            return;
        };
        let Some((cloud, votes)) = self.cloud.in_force(Some(now.cloud.version)) else {
            return;
        };
        if self.contradicted.of.as_ref().is_some_and(|of| of.is(&now)) {
            return;
        }
        if self
            .contradicted
            .of
            .as_ref()
            .is_none_or(|of| of.frame != number)
        {
            self.contradicted.answer = None;
        }
        self.contradicted.of = Some(now.clone());
        let store = Arc::clone(&self.store);
        self.contradicted.job = Some(self.start("contradicted", Kind::Background, move |_| {
            let answer = Arc::new(now.contradiction(&project, &store, (&cloud, &votes))?);
            Ok(Box::new(move |session: &mut Self| {
                if session
                    .contradicted
                    .of
                    .as_ref()
                    .is_some_and(|of| of.is(&now))
                {
                    session.contradicted.answer = Some(answer);
                }
                Ok(())
            }) as Landing)
        }));
    }
}

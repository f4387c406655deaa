use std::cell::Cell;
use std::sync::Arc;

use super::commands::by_vote;
use super::jobs::{Kind, Landing};
use super::store::version_in_force;
use super::{JobId, ResultKind, Session};
use crate::masks::{Region, RunMask};
use crate::scene::doubt::contradiction;

/// Where the vote of all contradicts the mask of one frame.
#[derive(Default)]
pub(super) struct Contradicted {
    wanted: Cell<Option<usize>>,
    of: Option<Compared>,
    answer: Option<Arc<Region>>,
    job: Option<JobId>,
}

/// What is compared: a frame's mask with a version of the cloud.
#[derive(Clone)]
struct Compared {
    frame: usize,
    mask: Arc<RunMask>,
    version: u64,
}

impl Compared {
    fn is(&self, other: &Self) -> bool {
        (self.frame, self.version) == (other.frame, other.version)
            && (Arc::ptr_eq(&self.mask, &other.mask) || self.mask == other.mask)
    }
}

impl Session {
    /// The pixels of a frame whose label the vote of all contradicts, and not only because a border lies a little aside: what
    /// accepting the vote would change. It is worked out in the background when it is first asked for; `None` until then.
    #[must_use]
    pub fn contradicted(&self, frame: usize) -> Option<&Arc<Region>> {
        self.contradicted.wanted.set(Some(frame));
        let same = self.contradicted.of.as_ref().is_some_and(|of| of.frame == frame);
        self.contradicted.answer.as_ref().filter(|_| same)
    }

    /// Starts to look for what was asked for, in the place of what was asked for before.
    pub(super) fn contradict_wanted(&mut self) {
        let (Some(number), Ok(project)) = (self.contradicted.wanted.take(), self.snapshot()) else { return };
        let version = version_in_force(&project, ResultKind::Cloud);
        let wanted = project.mask_in_play(number).zip(version);
        let wanted = wanted.map(|(mask, version)| Compared { frame: number, mask, version });
        let (Some(wanted), Some((cloud, votes))) = (wanted, self.cloud.in_force(version)) else { return };
        if self.contradicted.of.as_ref().is_some_and(|of| of.is(&wanted)) {
            return;
        }
        if let Some(job) = self.contradicted.job.take() {
            self.stop(job);
        }
        (self.contradicted.answer, self.contradicted.of) = (None, Some(wanted.clone()));
        let store = Arc::clone(&self.store);
        self.contradicted.job = Some(self.start("contradicted", Kind::Background, move |_| {
            let (own, voted) = by_vote((&project, &store), (&cloud, &votes), number, &[])?;
            let answer = Arc::new(contradiction(&own, &voted));
            Ok(Box::new(move |session: &mut Self| {
                if session.contradicted.of.as_ref().is_some_and(|of| of.is(&wanted)) {
                    session.contradicted.answer = Some(answer);
                }
                Ok(())
            }) as Landing)
        }));
    }
}

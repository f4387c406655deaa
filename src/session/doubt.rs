use std::collections::BTreeMap;
use std::sync::Arc;

use super::Session;
use super::cloud::CloudState;
use super::jobs::{Kind, Landing};
use crate::Event;
use ostra_cloud::doubt::{FrameDoubt, frame_doubt};
use ostra_core::job::JobId;
use ostra_masks::RunMask;

/// How much masks contradict the cloud that was made of them, by frame.
#[derive(Default)]
pub(super) struct Doubts {
    /// Which cloud it is.
    state: CloudState,
    by_frame: Arc<BTreeMap<usize, FrameDoubt>>,
    /// The mask that each frame had when it was compared.
    compared: BTreeMap<usize, Arc<RunMask>>,
    comparing: Option<JobId>,
    wanted: std::cell::Cell<bool>,
}

impl Session {
    /// By frame number, how much each mask contradicts the vote of all. It is worked out in the background when it is first
    /// asked for and after masks changed; by then it tells of the masks before. Empty without a cloud that knows who voted.
    #[must_use]
    pub fn doubts(&self) -> &Arc<BTreeMap<usize, FrameDoubt>> {
        self.doubts.wanted.set(true);
        &self.doubts.by_frame
    }

    /// Starts to compare the masks that changed.
    pub(super) fn compare_wanted(&mut self) {
        let is_comparing = |id| self.jobs.iter().any(|job| job.id == id && !job.has_ended());
        if !self.doubts.wanted.take() || self.doubts.comparing.is_some_and(is_comparing) {
            return;
        }
        let Ok(project) = self.snapshot() else { return };
        let state = self.cloud_state().unwrap_or_default();
        if state.version != self.doubts.state.version {
            self.doubts = Doubts::default();
        } else if state != self.doubts.state {
            // What was found by the votes before stands until it is found anew.
            self.doubts.compared.clear();
            let by_frame = Arc::make_mut(&mut self.doubts.by_frame);
            by_frame.retain(|&frame, _| project.mask_in_play(frame).is_some());
        }
        self.doubts.state = state;
        let Some((cloud, votes)) = self.cloud.in_force(Some(state.version)) else {
            return;
        };
        let voters: Vec<usize> = votes.frames().collect();
        let now = |frame: usize| project.mask_in_play(frame);
        let differs = |&frame: &usize| match (now(frame), self.doubts.compared.get(&frame)) {
            (Some(mask), Some(before)) => !Arc::ptr_eq(&mask, before) && mask != *before,
            (mask, before) => mask.is_some() || before.is_some(),
        };
        let changed: Vec<(usize, Option<Arc<RunMask>>)> = voters
            .into_iter()
            .filter(differs)
            .map(|frame| (frame, now(frame)))
            .collect();
        if changed.is_empty() {
            return;
        }
        self.doubts.comparing = Some(self.start("compare masks", Kind::Background, move |link| {
            let mut compared = Vec::with_capacity(changed.len());
            for (frame, mask) in changed {
                link.progress.check()?;
                let doubt = mask
                    .as_ref()
                    .map(|mask| frame_doubt(&votes, &cloud.labels, frame, &mask.decode()));
                compared.push((frame, mask, doubt));
            }
            Ok(Box::new(move |session: &mut Self| {
                session.take_doubts(state, compared);
                Ok(())
            }) as Landing)
        }));
    }

    fn take_doubts(
        &mut self,
        state: CloudState,
        compared: Vec<(usize, Option<Arc<RunMask>>, Option<FrameDoubt>)>,
    ) {
        if self.doubts.state != state {
            return;
        }
        let by_frame = Arc::make_mut(&mut self.doubts.by_frame);
        for (frame, mask, doubt) in compared {
            match mask.zip(doubt) {
                Some((mask, doubt)) => {
                    by_frame.insert(frame, doubt);
                    self.doubts.compared.insert(frame, mask);
                }
                None => {
                    by_frame.remove(&frame);
                    self.doubts.compared.remove(&frame);
                }
            }
        }
        self.events.push(Event::DoubtsChanged);
    }
}

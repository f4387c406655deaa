use std::sync::Arc;

use anyhow::{Context, Result, ensure};

use crate::Session;
use crate::queries::mask_by_vote;
use crate::{JobCompletion, JobKind};
use ostra_core::job::JobId;
use ostra_masks::LabelId;
use ostra_project::ResultKind;
use ostra_project::mask_edits::by_hand;
use ostra_project::reusable_votes::MaskByVote;
use ostra_project::store::version_in_force;
use ostra_project::voted_cloud::VotedCloud;

impl Session {
    /// Gives a frame the mask of the vote of all frames, for some labels or (empty) for all.
    pub(crate) fn accept_vote(&mut self, number: usize, labels: &[LabelId]) -> Result<JobId> {
        let project = self.snapshot()?;
        project.frame(number)?;
        let version = version_in_force(&project, ResultKind::Cloud)
            .context("there is no cloud yet; fuse first")?;
        let (loaded, root) = (
            self.background.cloud.voted(version),
            self.opened()?.root().to_owned(),
        );
        let (store, labels) = (Arc::clone(&self.store), labels.to_vec());
        Ok(
            self.start("Use the 3-D vote", JobKind::Short, move |context| {
                let loaded = match loaded {
                    Some(loaded) => loaded,
                    None => VotedCloud::read(&root, version, &project.frames, &context.progress)?,
                };
                let voted = loaded.up_to_date(&project, &store, &context.progress)?;
                let by_vote = MaskByVote {
                    cloud: &voted.cloud,
                    votes: &voted.votes,
                    frame: number,
                    labels: &labels,
                };
                let voted = mask_by_vote(&project, &store, &by_vote)?;
                Ok(Box::new(move |session: &mut Self| {
                    let now = session.snapshot()?;
                    ensure!(
                        now.masks.get(&number) == project.masks.get(&number),
                        "the mask of frame {number} changed meanwhile; accept again"
                    );
                    session.commit(
                        &format!("Use the 3-D vote on frame {number}"),
                        by_hand(&now, number, &voted.mask),
                    )?;
                    session.warn_all(voted.warning.into_iter().collect());
                    Ok(())
                }) as JobCompletion)
            }),
        )
    }
}

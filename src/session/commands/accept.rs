use std::sync::Arc;

use anyhow::{Context, Result, ensure};

use super::correct::without_depth;
use super::paint::by_hand;
use crate::Session;
use crate::following::cloud_of_now;
use crate::surfaces::load_cloud;
use crate::{Kind, Landing};
use ostra_cloud::SceneError;
use ostra_cloud::fuse::readable;
use ostra_core::job::JobId;
use ostra_frames::FrameStore;
use ostra_masks::{LabelId, LabelMask};
use ostra_project::reusable_votes::MaskByVote;
use ostra_project::store::version_in_force;
use ostra_project::{Project, ResultKind};

impl Session {
    /// Gives a frame the mask that the vote of all frames has, for some labels or (none named) for all.
    pub(crate) fn accept_vote(&mut self, number: usize, labels: &[LabelId]) -> Result<JobId> {
        let project = self.snapshot()?;
        project.frame(number)?;
        let version = version_in_force(&project, ResultKind::Cloud)
            .context("there is no cloud yet; fuse first")?;
        let (loaded, root) = (
            self.cloud.in_force(Some(version)),
            self.opened()?.root().to_owned(),
        );
        let (store, labels) = (Arc::clone(&self.store), labels.to_vec());
        Ok(self.start("Accept the vote", Kind::Short, move |link| {
            let loaded = match loaded {
                Some(loaded) => loaded,
                None => load_cloud(&root, version, &project.frames, &link.progress)?,
            };
            let (cloud, votes) = cloud_of_now((&project, &store), loaded, &link.progress)?;
            let by_vote = MaskByVote {
                cloud: &cloud,
                votes: &votes,
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
                    &format!("Accept the vote on frame {number}"),
                    by_hand(&now, number, &voted.mask),
                )?;
                session.warn_all(voted.warning.into_iter().collect());
                Ok(())
            }) as Landing)
        }))
    }
}

/// A mask, and a warning where the frame's depth cannot be read and is left out.
pub(crate) struct VotedMask {
    pub(crate) mask: LabelMask,
    pub(crate) warning: Option<String>,
}

/// Reads the frame's depth and projects the labels into it. A depth that cannot be read is left out, as if the frame had
/// none; a warning says so.
pub(crate) fn mask_by_vote(
    project: &Project,
    store: &FrameStore,
    by_vote: &MaskByVote<'_>,
) -> Result<VotedMask> {
    let frame = project.frame(by_vote.frame)?;
    let depth = readable(store.depth(frame).map_err(SceneError::from))?;
    let unread = [frame.name.as_str()];
    let warning = depth.is_none().then(|| without_depth(&unread)).flatten();
    let mask = by_vote.project(project, depth.flatten().as_deref())?;
    Ok(VotedMask { mask, warning })
}

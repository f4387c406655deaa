use std::sync::Arc;

use anyhow::{Context, Result, ensure};

use super::paint::{by_hand, mask_of};
use crate::frames::FrameStore;
use crate::masks::{LabelId, LabelMask};
use crate::scene::LabelledCloud;
use crate::scene::doubt::voted_mask;
use crate::scene::fuse::Votes;
use crate::session::following::cloud_of_now;
use crate::session::jobs::{Kind, Landing};
use crate::session::store::version_in_force;
use crate::session::surfaces::load_cloud;
use crate::session::{JobId, Project, ResultKind, Session};

impl Session {
    /// Gives a frame the mask that the vote of all frames has, for some labels or (none named) for all.
    pub(in crate::session) fn accept_vote(&mut self, number: usize, labels: &[LabelId]) -> Result<JobId> {
        let project = self.snapshot()?;
        project.frame(number)?;
        let version = version_in_force(&project, ResultKind::Cloud).context("there is no cloud yet; fuse first")?;
        let (loaded, root) = (self.cloud.in_force(Some(version)), self.opened()?.root().to_owned());
        let (store, labels) = (Arc::clone(&self.store), labels.to_vec());
        Ok(self.start("Accept the vote", Kind::Short, move |link| {
            let loaded = match loaded {
                Some(loaded) => loaded,
                None => load_cloud(&root, version, &project.frames, &link.progress)?,
            };
            let (cloud, votes) = cloud_of_now((&project, &store), loaded, &link.progress)?;
            let voted = by_vote((&project, &store), (&cloud, &votes), number, &labels)?;
            Ok(Box::new(move |session: &mut Self| {
                let now = session.snapshot()?;
                ensure!(
                    now.masks.get(&number) == project.masks.get(&number),
                    "the mask of frame {number} changed meanwhile; accept again"
                );
                session.commit(&format!("Accept the vote on frame {number}"), by_hand(&now, number, &voted))
            }) as Landing)
        }))
    }
}

/// The mask that the vote of all frames gives a frame, for some labels or (none named) for all.
pub(in crate::session) fn by_vote(
    (project, store): (&Project, &FrameStore),
    cloud: (&LabelledCloud, &Votes),
    number: usize,
    labels: &[LabelId],
) -> Result<LabelMask> {
    let frame = project.frame(number)?;
    let (depth, own) = (store.depth(frame)?, mask_of(project, number)?);
    let mut voted = voted_mask(cloud, (number, frame), depth.as_deref(), &own, labels)?;
    for (id, own) in voted.ids.iter_mut().zip(&own.ids) {
        // A label that was taken out since the vote stays out.
        if *id != LabelId::NONE && project.labels.get(*id).is_none() {
            *id = *own;
        }
    }
    Ok(voted)
}

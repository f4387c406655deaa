use std::sync::Arc;

use anyhow::{Context, Result, ensure};

use super::correct::without_depth;
use super::paint::{by_hand, mask_of};
use crate::Session;
use crate::following::cloud_of_now;
use crate::surfaces::load_cloud;
use crate::{Kind, Landing};
use ostra_cloud::doubt::voted_mask;
use ostra_cloud::fuse::{Votes, readable};
use ostra_cloud::{LabelledCloud, SceneError};
use ostra_core::job::JobId;
use ostra_frames::FrameStore;
use ostra_masks::{LabelId, LabelMask};
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
            let (voted, warning) = by_vote((&project, &store), (&cloud, &votes), number, &labels)?;
            Ok(Box::new(move |session: &mut Self| {
                let now = session.snapshot()?;
                ensure!(
                    now.masks.get(&number) == project.masks.get(&number),
                    "the mask of frame {number} changed meanwhile; accept again"
                );
                session.commit(
                    &format!("Accept the vote on frame {number}"),
                    by_hand(&now, number, &voted),
                )?;
                session.warn_all(warning.into_iter().collect());
                Ok(())
            }) as Landing)
        }))
    }
}

/// The mask that the vote of all frames gives a frame, for some labels or (none named) for all. A depth that
/// cannot be read is left aside, as if the frame had none; a warning says so.
pub(crate) fn by_vote(
    (project, store): (&Project, &FrameStore),
    cloud: (&LabelledCloud, &Votes),
    number: usize,
    labels: &[LabelId],
) -> Result<(LabelMask, Option<String>)> {
    let frame = project.frame(number)?;
    let (depth, own) = (
        readable(store.depth(frame).map_err(SceneError::from))?,
        mask_of(project, number)?,
    );
    let warning = if depth.is_none() {
        without_depth(&[frame.name.as_str()])
    } else {
        None
    };
    let depth = depth.flatten();
    let mut voted = voted_mask(cloud, (number, frame), depth.as_deref(), &own, labels)?;
    for (id, own) in voted.ids.iter_mut().zip(&own.ids) {
        // A label that was taken out since the vote stays out.
        if *id != LabelId::NONE && project.labels.get(*id).is_none() {
            *id = *own;
        }
    }
    Ok((voted, warning))
}

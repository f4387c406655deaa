use std::sync::Arc;

use super::commands::{FoundInstances, found_instances};
use super::following::cloud_of_now;
use super::jobs::{Kind, Landing};
use super::surfaces::load_cloud;
use super::{InstancesRequest, Session};
use crate::Event;
use ostra_cloud::LabelledCloud;
use ostra_masks::Label;

/// Instances as they would be made, to be looked at before they are.
#[derive(Debug, Clone, PartialEq)]
pub struct ProposedInstances {
    /// The label of each with its number of points, the largest first; none where nothing hangs together.
    pub labels: Vec<(Label, usize)>,
    /// The cloud as it would be labelled.
    pub cloud: Arc<LabelledCloud>,
}

impl Session {
    /// The instances that [`super::Command::Instances`] would make. As [`Self::cloud`] they are found by a job when they are
    /// first asked for: `None` until [`Event::CloudChanged`]. Nothing is committed.
    #[must_use]
    pub fn proposed_instances(&self, request: InstancesRequest) -> Option<&Arc<ProposedInstances>> {
        self.proposed.get((self.cloud_state()?, request))
    }

    /// Starts to look for what was asked for.
    pub(super) fn load_wanted_instances(&mut self) {
        let (Ok(project), Some(root)) =
            (self.snapshot(), self.root().map(std::path::Path::to_owned))
        else {
            return;
        };
        let Some((state, request)) = self.proposed.next_wanted() else {
            return;
        };
        let (loaded, store) = (
            self.cloud.in_force(Some(state.version)),
            std::sync::Arc::clone(&self.store),
        );
        self.start("Look for instances", Kind::Short, move |link| {
            let loaded = match loaded {
                Some(loaded) => loaded,
                None => load_cloud(&root, state.version, &project.frames, &link.progress)?,
            };
            let (cloud, _) = cloud_of_now((&project, &store), loaded, &link.progress)?;
            let found = found_instances(&project.labels, &cloud, &request, &link.progress)?;
            let proposed = Arc::new(proposal(&cloud, found)?);
            Ok(Box::new(move |session: &mut Self| {
                session.proposed.put((state, request), proposed);
                session.events.push(Event::CloudChanged);
                Ok(())
            }) as Landing)
        });
    }
}

fn proposal(cloud: &LabelledCloud, found: FoundInstances) -> anyhow::Result<ProposedInstances> {
    let mut cloud = cloud.clone();
    for label in &found.labels {
        cloud.tree.set(label.clone())?;
    }
    for (label, choice) in cloud.labels.iter_mut().zip(found.choice) {
        *label = choice.unwrap_or(*label);
    }
    Ok(ProposedInstances {
        labels: found.labels.into_iter().zip(found.sizes).collect(),
        cloud: Arc::new(cloud),
    })
}

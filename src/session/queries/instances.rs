use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use glam::Vec3;

use super::cloud::{CloudState, Snapshot};
use crate::jobs::JobKind;
use crate::query::QueryKey;
use crate::{Event, InstancesRequest};
use ostra_cloud::LabelledCloud;
use ostra_cloud::instances::Instances;
use ostra_core::job::Progress;
use ostra_masks::{Label, LabelId, LabelTree};

/// Instances as they would be made, to be looked at before they are.
#[derive(Debug, Clone, PartialEq)]
pub struct ProposedInstances {
    /// The label of each with its number of points, the largest first; none where nothing hangs together.
    pub labels: Vec<(Label, usize)>,
    /// The cloud as it would be labelled.
    pub cloud: Arc<LabelledCloud>,
}

/// A state of the cloud, and how it is told apart into instances.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct InstancesKey {
    pub(crate) cloud: CloudState,
    pub(crate) request: InstancesRequest,
}

impl QueryKey for InstancesKey {
    const TITLE: &'static str = "Find instances";
    const EVENT: Option<Event> = Some(Event::CloudChanged);

    fn kind(&self) -> JobKind {
        JobKind::Short
    }
}

/// Looks for instances in the cloud as the masks label it now.
///
/// # Errors
/// When a file of the cloud is missing or damaged, or the request does not fit it.
pub(crate) fn propose_instances(
    snapshot: &Snapshot,
    key: &InstancesKey,
    progress: &Progress,
) -> Result<ProposedInstances> {
    let voted = snapshot.voted_cloud(key.cloud.version, progress)?;
    let voted = voted.up_to_date(&snapshot.project, &snapshot.store, progress)?;
    let tree = &snapshot.project.labels;
    let found = find_instances(tree, &voted.cloud, &key.request, progress)?;
    proposal(&voted.cloud, found)
}

fn proposal(cloud: &LabelledCloud, found: FoundInstances) -> Result<ProposedInstances> {
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

/// Instances of a label, and what they would change.
pub(crate) struct FoundInstances {
    /// Their labels, the largest first.
    pub(crate) labels: Vec<Label>,
    /// Points of each.
    pub(crate) sizes: Vec<usize>,
    /// Along the points of the cloud: the new label of those that belong to one.
    pub(crate) choice: Vec<Option<LabelId>>,
}

/// Looks for instances among the points that carry the label itself. The preview and the command both call this, so that what is
/// proposed is what is made.
pub(crate) fn find_instances(
    tree: &LabelTree,
    cloud: &LabelledCloud,
    request: &InstancesRequest,
    progress: &Progress,
) -> Result<FoundInstances> {
    let points: Vec<usize> = (0..cloud.len())
        .filter(|&k| cloud.labels[k] == request.label)
        .collect();
    let positions: Vec<Vec3> = points.iter().map(|&k| cloud.positions[k]).collect();
    let Instances { of_points, sizes } =
        ostra_cloud::instances::find_instances(&positions, &request.options, progress)?;
    let labels = children(tree, request.label, sizes.len())?;
    let mut choice = vec![None; cloud.len()];
    for (&point, &number) in points
        .iter()
        .zip(&of_points)
        .filter(|(_, number)| **number > 0)
    {
        choice[point] = Some(labels[number as usize - 1].id);
    }
    Ok(FoundInstances {
        labels,
        sizes,
        choice,
    })
}

/// New labels below one: `wheel 1`, `wheel 2`, …; numbers whose name is taken are passed over.
fn children(tree: &LabelTree, parent: LabelId, count: usize) -> Result<Vec<Label>> {
    let mut tree = tree.clone();
    let stem = tree.get(parent).context("the label is gone")?.name.clone();
    let mut labels = Vec::new();
    let mut numbers = 1..;
    for _ in 0..count {
        let free = numbers
            .by_ref()
            .map(|n| format!("{stem} {n}"))
            .find(|name| tree.by_name(name).is_none());
        let (id, name) = (tree.next_id(), free.context("no name is free")?);
        ensure!(
            id != LabelId::NONE,
            "{count} instances are more than there are label ids left; ask for more points"
        );
        let label = Label {
            id,
            name,
            color: LabelTree::color_for(id),
            parent: Some(parent),
        };
        tree.set(label.clone())?;
        labels.push(label);
    }
    Ok(labels)
}

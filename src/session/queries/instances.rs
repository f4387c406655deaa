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

/// Instances that would be created, for preview.
#[derive(Debug, Clone, PartialEq)]
pub struct ProposedInstances {
    /// Label and number of points of each instance, the largest first.
    ///
    /// It is empty if no points are connected.
    pub labels: Vec<(Label, usize)>,
    /// The cloud as it would be labelled.
    pub cloud: Arc<LabelledCloud>,
}

/// A state of the cloud, and how it is divided into instances.
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

/// Finds instances in the cloud with the labels of the current masks.
///
/// # Errors
///
/// Returns an error if a file of the cloud is missing or damaged, or the request does not fit it.
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

/// Instances of a label, and the points that they would change.
pub(crate) struct FoundInstances {
    /// Labels of the instances, the largest first.
    pub(crate) labels: Vec<Label>,
    /// Number of points of each instance.
    pub(crate) sizes: Vec<usize>,
    /// New label of each point of the cloud that belongs to an instance.
    pub(crate) choice: Vec<Option<LabelId>>,
}

/// Finds instances among the points that have exactly this label.
///
/// Preview and command both call this function, so that the result matches the preview.
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

/// Returns new child labels of a label: `wheel 1`, `wheel 2`, …
///
/// Numbers whose names are taken are skipped.
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

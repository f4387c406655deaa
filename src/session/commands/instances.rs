use std::collections::BTreeSet;

use anyhow::{Context, Result, ensure};
use glam::Vec3;

use super::correct::Correcting;
use super::paint::label_name;
use crate::{InstancesRequest, Session};
use ostra_cloud::LabelledCloud;
use ostra_cloud::fuse::Votes;
use ostra_cloud::instances::{Instances, find_instances, split_mask};
use ostra_core::job::JobId;
use ostra_core::job::Progress;
use ostra_masks::{Label, LabelId, LabelTree, RunMask};
use ostra_project::mask_edits::changed;
use ostra_project::{Edit, Project};

impl Session {
    /// Makes a label below `label` for each group of its points that hangs together, gives it the pixels that see these
    /// points in every mask, and the points of the cloud with them, in one step.
    pub(crate) fn instances(&mut self, request: &InstancesRequest) -> Result<JobId> {
        request.options.check()?;
        let project = self.snapshot()?;
        let title = format!("Instances of {}", label_name(&project, request.label)?);
        let request = *request;
        self.correct(&title, move |correcting, progress| {
            Ok(correcting.split(&request, progress)?.into())
        })
    }
}

impl Correcting {
    /// The edits that make the labels and split the masks; what was not stale does not become so.
    fn split(&self, request: &InstancesRequest, progress: &Progress) -> Result<Vec<Edit>> {
        let project = &*self.project;
        let (cloud, votes) = self.cloud_of_now(progress)?;
        let found = found_instances(&project.labels, &cloud, request, progress)?;
        let name = label_name(project, request.label)?;
        ensure!(
            !found.labels.is_empty(),
            "no points of label '{name}' hang together; its points may carry labels below it, or ask for fewer points"
        );
        let mut edits: Vec<Edit> = found
            .labels
            .iter()
            .map(|label| Edit::SetLabel {
                id: label.id,
                label: Some(label.clone()),
            })
            .collect();
        edits.extend(split_masks(
            project,
            &votes,
            &found.choice,
            request.label,
            progress,
        )?);
        let is_fresh = |frame: &usize| project.masks.get(frame).is_some_and(|mask| !mask.stale);
        let frames = project.masks.keys().copied().filter(is_fresh).collect();
        edits.push(Edit::SetStale {
            frames,
            stale: false,
        });
        Ok(edits)
    }
}

/// Instances of a label, and what they would change.
pub(crate) struct FoundInstances {
    /// Their labels, the largest first.
    pub labels: Vec<Label>,
    /// Points of each.
    pub sizes: Vec<usize>,
    /// Along the points of the cloud: the new label of those that belong to one.
    pub choice: Vec<Option<LabelId>>,
}

/// Looks for instances among the points that carry the label itself.
pub(crate) fn found_instances(
    tree: &LabelTree,
    cloud: &LabelledCloud,
    request: &InstancesRequest,
    progress: &Progress,
) -> Result<FoundInstances> {
    let points: Vec<usize> = (0..cloud.len())
        .filter(|&k| cloud.labels[k] == request.label)
        .collect();
    let positions: Vec<Vec3> = points.iter().map(|&k| cloud.positions[k]).collect();
    let Instances { of_points, sizes } = find_instances(&positions, &request.options, progress)?;
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

fn split_masks(
    project: &Project,
    votes: &Votes,
    choice: &[Option<LabelId>],
    label: LabelId,
    progress: &Progress,
) -> Result<Vec<Edit>> {
    progress.stage("split masks")?;
    let labels: BTreeSet<LabelId> = choice.iter().flatten().copied().collect();
    let mut edits = Vec::new();
    for (done, (&frame, mask)) in project.masks.iter().enumerate() {
        progress.step(done, project.masks.len())?;
        let pixels = mask.runs.decode();
        let Some(split) = split_mask(votes, choice, (frame, &pixels), pixels.region(label)) else {
            continue;
        };
        let runs = RunMask::encode(&split);
        let shown: Vec<LabelId> = runs.extents().into_keys().collect();
        edits.extend(changed(project, frame, mask, runs, |sure| {
            let of_label = sure.get(&label).copied();
            let new = shown.iter().filter(|id| labels.contains(id));
            sure.extend(new.filter_map(|&id| Some((id, of_label?))));
            sure.retain(|id, _| shown.contains(id));
        }));
    }
    Ok(edits)
}

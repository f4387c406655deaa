use std::collections::BTreeSet;

use super::correct::Correcting;
use crate::queries::find_instances;
use crate::{InstancesRequest, Session};
use anyhow::{Result, ensure};
use ostra_cloud::fuse::Votes;
use ostra_cloud::instances::split_mask;
use ostra_core::job::JobId;
use ostra_core::job::Progress;
use ostra_masks::{LabelId, RunMask};
use ostra_project::mask_edits::{changed, label_name};
use ostra_project::voted_cloud::VotedCloud;
use ostra_project::{Edit, Project};

impl Session {
    /// Creates a label below `label` for each connected group of its points.
    ///
    /// The points of the cloud and the pixels that see them in every mask change in one step.
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
    /// Returns the edits that create the labels and split the masks.
    ///
    /// Masks that were not stale stay so.
    fn split(&self, request: &InstancesRequest, progress: &Progress) -> Result<Vec<Edit>> {
        let project = &*self.project;
        let VotedCloud { cloud, votes } = self.cloud_of_now(progress)?;
        let found = find_instances(&project.labels, &cloud, request, progress)?;
        let name = label_name(project, request.label)?;
        ensure!(
            !found.labels.is_empty(),
            "label '{name}' has no connected group of enough points; its points may have labels below it, or lower the minimum number of points"
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
        let Some(split) = split_mask(votes, choice, frame, &pixels, pixels.region(label)) else {
            continue;
        };
        let runs = RunMask::encode(&split);
        let shown: Vec<LabelId> = runs.extents().into_keys().collect();
        edits.extend(changed(project, frame, mask, runs, |confidence| {
            let of_label = confidence.get(&label).copied();
            let new = shown.iter().filter(|id| labels.contains(id));
            confidence.extend(new.filter_map(|&id| Some((id, of_label?))));
            confidence.retain(|id, _| shown.contains(id));
        }));
    }
    Ok(edits)
}

use anyhow::{Context, Result};

use crate::Session;
use ostra_core::job::JobId;
use ostra_masks::{Label, LabelId};
use ostra_project::mask_edits::label_name;
use ostra_project::store::version_in_force;
use ostra_project::{Edit, ResultKind, label_edits};

impl Session {
    pub(crate) fn add_label(
        &mut self,
        name: &str,
        parent: Option<&str>,
        color: Option<[u8; 3]>,
    ) -> Result<()> {
        let label = label_edits::new_label(&self.snapshot()?.labels, name, parent, color)?;
        self.commit(
            &format!("Add label {}", label.name),
            vec![Edit::SetLabel {
                id: label.id,
                label: Some(label),
            }],
        )
    }

    pub(crate) fn edit_label(&mut self, label: &Label) -> Result<()> {
        let project = self.snapshot()?;
        let before = project.labels.get(label.id).with_context(|| {
            format!(
                "there is no label {}; 'ostra info' lists the labels",
                label.id.0
            )
        })?;
        let title = format!("Change label {}", before.name);
        self.commit(
            &title,
            vec![Edit::SetLabel {
                id: label.id,
                label: Some(label.clone()),
            }],
        )
    }

    pub(crate) fn remove_label(&mut self, id: LabelId) -> Result<()> {
        let project = self.snapshot()?;
        let name = &project
            .labels
            .get(id)
            .with_context(|| format!("there is no label {}; 'ostra info' lists the labels", id.0))?
            .name;
        self.commit(
            &format!("Remove label {name}"),
            label_edits::remove(&project, id),
        )
    }

    /// Merges two labels on all frames and in the cloud, in one step.
    ///
    /// Runs as a job if there is a cloud that must vote again.
    pub(crate) fn merge_labels(&mut self, label: LabelId, into: LabelId) -> Result<Option<JobId>> {
        let project = self.snapshot()?;
        let title = format!(
            "Merge {} into {}",
            label_name(&project, label)?,
            label_name(&project, into)?
        );
        let edits = label_edits::merge(&project, label, into)?;
        if version_in_force(&project, ResultKind::Cloud).is_none() {
            return self.commit(&title, edits).map(|()| None);
        }
        self.correct(&title, |_, _| Ok(edits.into())).map(Some)
    }
}

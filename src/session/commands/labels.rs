use std::sync::Arc;

use anyhow::{Context, Result, ensure};

use crate::Session;
use ostra_masks::{Label, LabelId, LabelTree};
use ostra_project::{Edit, FrameMask, Marks, Project};

impl Session {
    pub(crate) fn add_label(
        &mut self,
        name: &str,
        parent: Option<&str>,
        color: Option<[u8; 3]>,
    ) -> Result<()> {
        let project = self.snapshot()?;
        let id = project.labels.next_id();
        ensure!(
            id != LabelId::NONE,
            "all 65535 label ids are taken; remove a label first"
        );
        let parent = parent.map(|parent| {
            let found = project.labels.by_name(parent).map(|label| label.id);
            found.with_context(|| {
                format!("there is no label '{parent}' to be the parent; make it first")
            })
        });
        let color = color.unwrap_or_else(|| LabelTree::color_for(id));
        let label = Label {
            id,
            name: name.trim().to_owned(),
            color,
            parent: parent.transpose()?,
        };
        self.commit(
            &format!("Add label {}", label.name),
            vec![Edit::SetLabel {
                id,
                label: Some(label),
            }],
        )
    }

    pub(crate) fn edit_label(&mut self, label: &Label) -> Result<()> {
        let project = self.snapshot()?;
        let before = project
            .labels
            .get(label.id)
            .with_context(|| format!("there is no label {}", label.id.0))?;
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
            .with_context(|| format!("there is no label {}", id.0))?
            .name;
        let mut edits = vec![];
        edits.extend(
            project
                .prompts
                .keys()
                .filter(|(_, label)| *label == id)
                .map(|&(frame, label)| Edit::SetPrompt {
                    frame,
                    label,
                    prompt: None,
                }),
        );
        edits.extend(masks_without(&project, id));
        edits.push(Edit::SetMarks {
            label: id,
            marks: Marks::default(),
        });
        edits.push(Edit::SetLabel { id, label: None });
        self.commit(&format!("Remove label {name}"), edits)
    }
}

/// The masks that hold the label, without its pixels.
fn masks_without(project: &Project, id: LabelId) -> impl Iterator<Item = Edit> {
    let holding = project
        .masks
        .iter()
        .filter(move |(_, mask)| mask.runs.runs.iter().any(|&(run, _)| run == id));
    holding.map(move |(&frame, mask)| {
        let runs = mask
            .runs
            .map_ids(|at| if at == id { LabelId::NONE } else { at });
        let mut mask = FrameMask {
            runs: Arc::new(runs),
            ..mask.clone()
        };
        mask.confidence.remove(&id);
        Edit::SetMask {
            frame,
            mask: Some(mask),
        }
    })
}

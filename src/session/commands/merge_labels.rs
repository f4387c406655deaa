use std::collections::BTreeSet;

use anyhow::{Context, Result, ensure};

use super::range::merge;
use crate::mask_edits::{check_unlocked, label_name};
use crate::{RangeChange, RangeRequest, Session};
use ostra_core::job::JobId;
use ostra_masks::{Label, LabelId};
use ostra_project::store::version_in_force;
use ostra_project::{Edit, Marks, Project, ResultKind};

impl Session {
    /// Makes two labels one on all frames and in the cloud, in one step; a job where there is a cloud to vote again.
    pub(crate) fn merge_labels(&mut self, label: LabelId, into: LabelId) -> Result<Option<JobId>> {
        let project = self.snapshot()?;
        let title = format!(
            "Merge {} into {}",
            label_name(&project, label)?,
            label_name(&project, into)?
        );
        let edits = merged(&project, label, into)?;
        if version_in_force(&project, ResultKind::Cloud).is_none() {
            return self.commit(&title, edits).map(|()| None);
        }
        self.correct(&title, |_, _| Ok(edits.into())).map(Some)
    }
}

/// The edits that give all a label has to another one, and take it out.
fn merged(project: &Project, label: LabelId, into: LabelId) -> Result<Vec<Edit>> {
    ensure!(
        label != into,
        "a label cannot be merged into itself; name another one"
    );
    let last = project.frames.len().saturating_sub(1);
    let change = RangeChange::Merge { into };
    let everywhere = RangeRequest {
        labels: vec![label],
        from: 0,
        to: last,
        change,
        replace: false,
    };
    for (&frame, mask) in &project.masks {
        if mask.runs.runs.iter().any(|&(id, _)| id == label) {
            [label, into]
                .into_iter()
                .try_for_each(|label| check_unlocked(project, frame, label))?;
        }
    }
    let mut edits = merge(project, &everywhere, &BTreeSet::from([label]), into);
    edits.extend(project.there_again(&edits));
    let taken: BTreeSet<usize> = edits.iter().filter_map(Edit::masked_frame).collect();
    let left = project
        .prompts
        .keys()
        .filter(|(frame, of)| *of == label && !taken.contains(frame));
    edits.extend(left.map(|&(frame, label)| Edit::SetPrompt {
        frame,
        label,
        prompt: None,
    }));
    edits.push(Edit::SetMarks {
        label,
        marks: Marks::default(),
    });
    edits.extend(adopted(project, label, into)?);
    edits.push(Edit::SetLabel {
        id: label,
        label: None,
    });
    Ok(edits)
}

/// The edits that give a label's children to another label, which takes its place where it lies below it.
fn adopted(project: &Project, label: LabelId, into: LabelId) -> Result<Vec<Edit>> {
    let tree = &project.labels;
    let gone = tree
        .get(label)
        .with_context(|| format!("there is no label {}", label.0))?;
    let under = |child: &Label, parent: Option<LabelId>| Edit::SetLabel {
        id: child.id,
        label: Some(Label {
            parent,
            ..child.clone()
        }),
    };
    let below = tree.get(into).filter(|_| tree.path(into).contains(&label));
    let children = tree
        .iter()
        .filter(|child| child.parent == Some(label) && child.id != into);
    Ok(below
        .map(|into| under(into, gone.parent))
        .into_iter()
        .chain(children.map(|child| under(child, Some(into))))
        .collect())
}

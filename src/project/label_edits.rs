//! Edits that add, remove and merge labels.

use std::collections::BTreeSet;
use std::sync::Arc;

use anyhow::{Context, Result, ensure};

use crate::mask_edits::check_unlocked;
use crate::{Edit, FrameMask, Marks, Project, RangeChange, RangeRequest, range};
use ostra_masks::{Label, LabelId, LabelTree};

/// Creates a label with the next free id.
///
/// # Errors
///
/// Returns an error if all ids are taken, or there is no label with the parent's name.
pub fn new_label(
    tree: &LabelTree,
    name: &str,
    parent: Option<&str>,
    color: Option<[u8; 3]>,
) -> Result<Label> {
    let id = tree.next_id();
    ensure!(
        id != LabelId::NONE,
        "all 65535 label ids are taken; remove a label first"
    );
    let parent = parent.map(|parent| {
        let found = tree.by_name(parent).map(|label| label.id);
        found.with_context(|| {
            format!("there is no label '{parent}' to be the parent; make it first")
        })
    });
    Ok(Label {
        id,
        name: name.trim().to_owned(),
        color: color.unwrap_or_else(|| LabelTree::color_for(id)),
        parent: parent.transpose()?,
    })
}

/// Returns the edits that remove a label with its prompts, pixels and marks.
#[must_use]
pub fn remove(project: &Project, id: LabelId) -> Vec<Edit> {
    let prompts = project.prompts.keys().filter(|(_, label)| *label == id);
    let mut edits: Vec<Edit> = prompts
        .map(|&(frame, label)| Edit::SetPrompt {
            frame,
            label,
            prompt: None,
        })
        .collect();
    edits.extend(masks_without(project, id));
    edits.push(Edit::SetMarks {
        label: id,
        marks: Marks::default(),
    });
    edits.push(Edit::SetLabel { id, label: None });
    edits
}

/// Returns the edits that remove a label's pixels from all masks.
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

/// Returns the edits that transfer everything of one label to another label and remove it.
///
/// # Errors
///
/// Returns an error if a label is missing, both are the same, or either is locked on a frame that
/// shows the first.
pub fn merge(project: &Project, label: LabelId, into: LabelId) -> Result<Vec<Edit>> {
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
    let mut edits = range::merge(project, &everywhere, &BTreeSet::from([label]), into);
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
    edits.extend(moved_children(project, label, into)?);
    edits.push(Edit::SetLabel {
        id: label,
        label: None,
    });
    Ok(edits)
}

/// Returns the edits that move a label's children to another label.
///
/// If the other label is a descendant of the label, it takes the label's place in the tree.
fn moved_children(project: &Project, label: LabelId, into: LabelId) -> Result<Vec<Edit>> {
    let tree = &project.labels;
    let gone = tree.get(label).with_context(|| {
        format!(
            "there is no label {}; 'ostra info' lists the labels",
            label.0
        )
    })?;
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

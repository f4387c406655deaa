//! Changes of labels over a range of frames.
//!
//! Pixels of other labels and of locked labels stay unchanged.

use std::collections::BTreeSet;
use std::sync::Arc;

use anyhow::{Context, Result, ensure};

use crate::interpolate::interpolate;
use crate::mask_edits::{changed, keyframe_of, label_name};
use crate::split::{Cut, split};
use crate::{Edit, FrameMask, Marks, Project, RangeChange, RangeRequest};
use ostra_core::job::Progress;
use ostra_frames::FrameSet;
use ostra_masks::{AnswerSize, Click, LabelId, Prompt, RunMask, transfer};

/// Returns whether a change reads so many masks that it should run on a worker thread.
#[must_use]
pub fn takes_time(change: RangeChange) -> bool {
    matches!(change, RangeChange::Interpolate | RangeChange::Split { .. })
}

/// Returns the edits that make a change for these labels, or none if nothing changes.
///
/// [`labels_of`] returns the labels.
///
/// # Errors
///
/// Returns an error if the frames do not show what the change needs, or the progress is stopped.
pub fn edits(
    project: &Project,
    request: &RangeRequest,
    labels: &BTreeSet<LabelId>,
    progress: &Progress,
) -> Result<Vec<Edit>> {
    let (from, to) = (request.from, request.to);
    Ok(match request.change {
        RangeChange::Delete => delete(project, request, labels),
        RangeChange::Restore => mark(project, labels, |marks| marks.absent.remove(from, to)),
        RangeChange::Lock => mark(project, labels, |marks| marks.locked.insert(from, to)),
        RangeChange::Unlock => mark(project, labels, |marks| marks.locked.remove(from, to)),
        RangeChange::Hide => mark(project, labels, |marks| marks.hidden.insert(from, to)),
        RangeChange::Show => mark(project, labels, |marks| marks.hidden.remove(from, to)),
        RangeChange::Merge { into } => merge(project, request, labels, into),
        RangeChange::Copy { frame } => copy(project, request, labels, frame)?,
        RangeChange::Interpolate => interpolate(project, request, labels, progress)?,
        RangeChange::Split { frame, at_px, into } => {
            let label = labels
                .first()
                .copied()
                .context("no label was named; choose one")?;
            let cut = Cut {
                label,
                into,
                frame,
                at_px,
            };
            split(project, request, &cut, progress)?
        }
    })
}

/// Returns the labels that a request applies to.
///
/// # Errors
///
/// Returns an error if a label or frame in the request is missing, or the request contradicts
/// itself.
pub fn labels_of(project: &Project, request: &RangeRequest) -> Result<BTreeSet<LabelId>> {
    project.frame(request.from)?;
    project.frame(request.to)?;
    ensure!(
        request.from <= request.to,
        "frame {} comes after frame {}; give the earlier one first",
        request.from,
        request.to
    );
    request
        .labels
        .iter()
        .try_for_each(|&label| label_name(project, label).map(drop))?;
    let mut labels: BTreeSet<LabelId> = match request.labels.as_slice() {
        [] => project.labels.iter().map(|label| label.id).collect(),
        some => some.iter().copied().collect(),
    };
    match request.change {
        RangeChange::Merge { into } => {
            label_name(project, into)?;
            ensure!(
                request.labels != [into],
                "a label cannot be merged into itself; name another one"
            );
            labels.remove(&into);
        }
        RangeChange::Split { frame, into, .. } => {
            label_name(project, into)?;
            ensure!(
                request.labels.len() == 1,
                "name the one label that is to be split"
            );
            ensure!(
                !labels.contains(&into),
                "the part needs another label than the whole"
            );
            ensure!(
                (request.from..=request.to).contains(&frame),
                "frame {frame} lies outside the range"
            );
        }
        RangeChange::Copy { frame } => {
            project
                .masks
                .get(&frame)
                .with_context(|| format!("frame {frame} has no mask to copy"))?;
        }
        _ => {}
    }
    Ok(labels)
}

/// Returns the title of the step that makes a change.
///
/// # Errors
///
/// Returns an error if a label in the request is missing.
pub fn title(
    project: &Project,
    request: &RangeRequest,
    labels: &BTreeSet<LabelId>,
) -> Result<String> {
    let name = |id: LabelId| label_name(project, id);
    let what = match request.labels.is_empty() {
        true => "all labels".to_owned(),
        false => labels
            .iter()
            .map(|&id| name(id))
            .collect::<Result<Vec<_>>>()?
            .join(", "),
    };
    let place = match (request.from, request.to) {
        (from, to) if from == to => format!("on frame {from}"),
        (from, to) => format!("on frames {from} to {to}"),
    };
    Ok(match request.change {
        RangeChange::Delete => format!("Delete {what} {place}"),
        RangeChange::Restore => format!("Let {what} be {place} again"),
        RangeChange::Lock => format!("Lock {what} {place}"),
        RangeChange::Unlock => format!("Unlock {what} {place}"),
        RangeChange::Hide => format!("Hide {what} {place}"),
        RangeChange::Show => format!("Show {what} {place}"),
        RangeChange::Merge { into } => format!("Merge {what} into {} {place}", name(into)?),
        RangeChange::Split { into, .. } => format!("Split {} off {what} {place}", name(into)?),
        RangeChange::Interpolate => format!("Interpolate {what} {place}"),
        RangeChange::Copy { frame } => format!("Copy {what} of frame {frame} {place}"),
    })
}

/// Returns the edits that change the marks of labels.
fn mark(project: &Project, labels: &BTreeSet<LabelId>, change: impl Fn(&mut Marks)) -> Vec<Edit> {
    let changed = labels.iter().filter_map(|&label| {
        let before = project.marks_of(label);
        let mut marks = before.clone();
        change(&mut marks);
        (marks != before).then_some(Edit::SetMarks { label, marks })
    });
    changed.collect()
}

/// Returns the edits that remove pixels, prompts and confidences of labels.
///
/// The labels are marked as absent, so that no tracker puts them there again.
fn delete(project: &Project, request: &RangeRequest, labels: &BTreeSet<LabelId>) -> Vec<Edit> {
    let mut edits = without_prompts(project, request, labels);
    edits.extend(masks_of(project, request).filter_map(|(frame, mask)| {
        let gone = |id: LabelId| {
            if labels.contains(&id) {
                LabelId::NONE
            } else {
                id
            }
        };
        changed(
            project,
            frame,
            mask,
            mask.runs.map_ids(gone),
            |confidence| {
                confidence.retain(|id, _| !labels.contains(id));
            },
        )
    }));
    edits.extend(labels.iter().filter_map(|&label| {
        let before = project.marks_of(label);
        let mut gone = FrameSet::from(vec![(request.from, request.to)]);
        before
            .locked
            .ranges()
            .for_each(|locked| gone.remove(*locked.start(), *locked.end()));
        let mut marks = before.clone();
        gone.ranges()
            .for_each(|range| marks.absent.insert(*range.start(), *range.end()));
        (marks != before).then_some(Edit::SetMarks { label, marks })
    }));
    edits
}

/// Returns the edits that transfer pixels and prompts to `into`.
pub(crate) fn merge(
    project: &Project,
    request: &RangeRequest,
    labels: &BTreeSet<LabelId>,
    into: LabelId,
) -> Vec<Edit> {
    let mut edits: Vec<Edit> = masks_of(project, request)
        .filter(|(frame, _)| !project.locked_on(*frame).contains(&into))
        .filter_map(|(frame, mask)| {
            let locked = project.locked_on(frame);
            let goes = |id: &LabelId| labels.contains(id) && !locked.contains(id);
            let runs = mask.runs.map_ids(|id| if goes(&id) { into } else { id });
            changed(project, frame, mask, runs, |confidence| {
                let least = confidence
                    .iter()
                    .filter(|(id, _)| goes(id) || **id == into)
                    .map(|(_, &confidence)| confidence);
                let least = least.reduce(f32::min);
                confidence.retain(|id, _| !goes(id));
                confidence.extend(least.map(|least| (into, least)));
            })
        })
        .collect();
    let frames: BTreeSet<usize> = edits.iter().filter_map(Edit::masked_frame).collect();
    edits.extend(
        frames
            .into_iter()
            .flat_map(|frame| merged_prompts(project, frame, labels, into)),
    );
    edits
}

fn merged_prompts(
    project: &Project,
    frame: usize,
    labels: &BTreeSet<LabelId>,
    into: LabelId,
) -> Vec<Edit> {
    let given = |label: LabelId| project.prompts.get(&(frame, label));
    let locked = project.locked_on(frame);
    let moved: Vec<(LabelId, &Prompt)> = labels
        .iter()
        .filter(|id| !locked.contains(id))
        .filter_map(|&id| Some((id, given(id)?)))
        .collect();
    if moved.is_empty() {
        return Vec::new();
    }
    let corrects = moved.iter().all(|(_, other)| other.corrects);
    let mut prompt = given(into).cloned().unwrap_or_else(|| Prompt {
        corrects,
        ..Prompt::default()
    });
    prompt.size = AnswerSize::Automatic;
    let mut edits = Vec::new();
    for (label, other) in moved {
        prompt.clicks.extend(
            other
                .clicks
                .iter()
                .filter(|click| click.include)
                .copied()
                .collect::<Vec<Click>>(),
        );
        prompt.boxes.extend(other.boxes.iter().copied());
        edits.push(Edit::SetPrompt {
            frame,
            label,
            prompt: None,
        });
    }
    if !prompt.is_empty() {
        edits.push(Edit::SetPrompt {
            frame,
            label: into,
            prompt: Some(prompt),
        });
    }
    edits
}

/// Returns the edits that copy labels of another frame's mask to the frames of the range.
///
/// These frames become keyframes.
fn copy(
    project: &Project,
    request: &RangeRequest,
    labels: &BTreeSet<LabelId>,
    source: usize,
) -> Result<Vec<Edit>> {
    let from = project
        .masks
        .get(&source)
        .with_context(|| format!("frame {source} has no mask to copy"))?;
    let shown = labels
        .iter()
        .any(|label| from.runs.runs.iter().any(|(id, _)| id == label));
    ensure!(shown, "frame {source} does not show the labels to copy");
    let mut edits = Vec::new();
    for frame in (request.from..=request.to).filter(|&frame| frame != source) {
        let of = project.frame(frame)?;
        let nothing = || Arc::new(RunMask::empty(of.width, of.height));
        let before = project
            .masks
            .get(&frame)
            .map_or_else(nothing, |mask| Arc::clone(&mask.runs));
        let open = labels - &project.locked_on(frame);
        let runs = project.with_locks(
            frame,
            Arc::new(transfer(&before, &from.runs, &open, request.replace)?),
        );
        if runs == before {
            continue;
        }
        let given = open
            .into_iter()
            .filter(|&label| project.prompts.contains_key(&(frame, label)));
        edits.extend(given.map(|label| Edit::SetPrompt {
            frame,
            label,
            prompt: None,
        }));
        edits.push(Edit::SetMask {
            frame,
            mask: Some(keyframe_of(runs)),
        });
    }
    Ok(edits)
}

/// Returns the masks of the range.
fn masks_of<'a>(
    project: &'a Project,
    request: &RangeRequest,
) -> impl Iterator<Item = (usize, &'a FrameMask)> + use<'a> {
    project
        .masks
        .range(request.from..=request.to)
        .map(|(&frame, mask)| (frame, mask))
}

/// Returns the edits that remove prompts of labels on frames where they are not locked.
fn without_prompts(
    project: &Project,
    request: &RangeRequest,
    labels: &BTreeSet<LabelId>,
) -> Vec<Edit> {
    let range = (request.from, LabelId(0))..=(request.to, LabelId(u16::MAX));
    let goes = |frame: usize, label: &LabelId| {
        labels.contains(label) && !project.locked_on(frame).contains(label)
    };
    let given = project
        .prompts
        .range(range)
        .filter(|((frame, label), _)| goes(*frame, label));
    given
        .map(|(&(frame, label), _)| Edit::SetPrompt {
            frame,
            label,
            prompt: None,
        })
        .collect()
}

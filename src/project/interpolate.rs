//! Interpolation of the shapes of labels between two frames.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use anyhow::{Context, Result, ensure};

use crate::mask_edits::label_name;
use crate::{Edit, FrameMask, MaskOrigin, Project, RangeRequest};
use ostra_core::job::Progress;
use ostra_masks::{LabelId, LabelMask, RunMask, ShapeBlend, transfer};

/// Returns the edits that interpolate labels between the first and the last frame of the range.
///
/// A keyframe in between keeps the labels that it shows, and stays a keyframe.
pub(crate) fn interpolate(
    project: &Project,
    request: &RangeRequest,
    labels: &BTreeSet<LabelId>,
    progress: &Progress,
) -> Result<Vec<Edit>> {
    progress.stage("interpolate")?;
    let blends = blends(project, request, labels)?;
    let between = request.to - request.from;
    let mut edits = Vec::new();
    for frame in request.from + 1..request.to {
        progress.step(frame - request.from, between)?;
        let share = (frame - request.from) as f64 / between as f64;
        edits.extend(blended_frame(project, request, &blends, frame, share)?);
    }
    Ok(edits)
}

fn blended_frame(
    project: &Project,
    request: &RangeRequest,
    blends: &BTreeMap<LabelId, ShapeBlend>,
    frame: usize,
    share: f64,
) -> Result<Option<Edit>> {
    let of = project.frame(frame)?;
    let empty = RunMask::empty(of.width, of.height);
    let nothing = FrameMask {
        runs: Arc::new(empty),
        origin: MaskOrigin::Tracked,
        stale: false,
        confidence: BTreeMap::new(),
    };
    let before = project.masks.get(&frame).unwrap_or(&nothing);
    let given = |label: &LabelId| {
        before.origin == MaskOrigin::Keyframe && before.runs.runs.iter().any(|(id, _)| id == label)
    };
    let barred = &project.absent_on(frame) | &project.locked_on(frame);
    let is_open = |label: &LabelId| !given(label) && !barred.contains(label);
    let chosen: BTreeSet<LabelId> = blends.keys().copied().filter(is_open).collect();
    let mut shapes = LabelMask::empty(of.width, of.height);
    for label in &chosen {
        let inside = blends[label].at(share).inside;
        shapes
            .ids
            .iter_mut()
            .zip(inside)
            .filter(|(_, inside)| *inside)
            .for_each(|(id, _)| *id = *label);
    }
    let runs = transfer(
        &before.runs,
        &RunMask::encode(&shapes),
        &chosen,
        request.replace,
    )?;
    let mut confidence = before.confidence.clone();
    confidence.retain(|label, _| !chosen.contains(label));
    let mask = FrameMask {
        runs: project.with_locks(frame, Arc::new(runs)),
        confidence,
        ..before.clone()
    };
    Ok((mask.runs != before.runs).then_some(Edit::SetMask {
        frame,
        mask: Some(mask),
    }))
}

/// Returns a blend for each label that both ends show.
fn blends(
    project: &Project,
    request: &RangeRequest,
    labels: &BTreeSet<LabelId>,
) -> Result<BTreeMap<LabelId, ShapeBlend>> {
    let mask = |frame: usize| {
        project
            .masks
            .get(&frame)
            .with_context(|| format!("frame {frame} has no mask"))
    };
    let (first, last) = (mask(request.from)?, mask(request.to)?);
    ensure!(
        request.to > request.from + 1,
        "there is no frame between {} and {}",
        request.from,
        request.to
    );
    let mut blends = BTreeMap::new();
    for &label in labels {
        let (a, b) = (first.runs.region(label), last.runs.region(label));
        if !a.is_empty() && !b.is_empty() {
            blends.insert(label, ShapeBlend::new(&a, &b)?);
        } else if request.labels.contains(&label) {
            let missing = if a.is_empty() {
                request.from
            } else {
                request.to
            };
            anyhow::bail!(
                "label '{}' is not on frame {missing}; give it there first",
                label_name(project, label)?
            );
        }
    }
    ensure!(
        !blends.is_empty(),
        "frames {} and {} show no label in common",
        request.from,
        request.to
    );
    Ok(blends)
}

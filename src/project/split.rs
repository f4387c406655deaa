//! Splitting one piece off a label over a range of frames.

use anyhow::{Context, Result, ensure};
use glam::DVec2;

use crate::mask_edits::{changed, label_name};
use crate::{Edit, FrameMask, Project, RangeRequest};
use ostra_core::job::Progress;
use ostra_masks::{
    AnswerSize, Click, Connectivity, LabelId, Prompt, Region, RunMask, components, nearer_part,
};

/// The piece of a label that becomes another label.
pub(crate) struct Cut {
    pub label: LabelId,
    pub into: LabelId,
    /// Frame on which the piece is selected.
    pub frame: usize,
    pub at_px: DVec2,
}

/// Returns the edits that give a piece of a label to another label.
///
/// From the selected frame, the piece is followed in both directions. On each frame it consists of
/// the pixels nearer to the previous piece than to the rest of the label.
pub(crate) fn split(
    project: &Project,
    request: &RangeRequest,
    cut: &Cut,
    progress: &Progress,
) -> Result<Vec<Edit>> {
    progress.stage("split")?;
    let mask = project
        .masks
        .get(&cut.frame)
        .with_context(|| format!("frame {} has no mask", cut.frame))?;
    let (part, rest) = pointed_at(project, cut, &mask.runs)?;
    let mut edits = piece_edits(project, cut, cut.frame, mask, &part);
    let after: Vec<usize> = project
        .masks
        .range(cut.frame..=request.to)
        .skip(1)
        .map(|(&frame, _)| frame)
        .collect();
    let before: Vec<usize> = project
        .masks
        .range(request.from..cut.frame)
        .rev()
        .map(|(&frame, _)| frame)
        .collect();
    let total = after.len() + before.len();
    let mut done = 0;
    for way in [after, before] {
        let mut last = (part.clone(), rest.clone());
        for frame in way {
            progress.step(done, total)?;
            done += 1;
            edits.extend(next_frame(project, cut, frame, &mut last)?);
        }
    }
    Ok(edits)
}

/// Returns the piece of the label around the selected pixel, and the rest of the label.
fn pointed_at(project: &Project, cut: &Cut, runs: &RunMask) -> Result<(Region, Region)> {
    let name = label_name(project, cut.label)?;
    let whole = runs.region(cut.label);
    let at = Click {
        at_px: cut.at_px,
        include: true,
    }
    .pixel_in(whole.width, whole.height);
    let pieces = components(&whole, Connectivity::Eight);
    let piece = at.map(|at| pieces.labels[at]).filter(|&piece| piece > 0);
    let piece = piece
        .with_context(|| format!("that pixel of frame {} is not label '{name}'", cut.frame))?;
    let of = |mine: bool| Region {
        width: whole.width,
        height: whole.height,
        inside: pieces
            .labels
            .iter()
            .map(|&other| other > 0 && (other == piece) == mine)
            .collect(),
    };
    let (part, rest) = (of(true), of(false));
    ensure!(
        !rest.is_empty(),
        "label '{name}' is one connected part on frame {}; paint the part with the other label instead",
        cut.frame
    );
    Ok((part, rest))
}

/// Splits the label on the next frame, and stores the result in `last` for the frame after it.
fn next_frame(
    project: &Project,
    cut: &Cut,
    frame: usize,
    last: &mut (Region, Region),
) -> Result<Vec<Edit>> {
    let Some(mask) = project.masks.get(&frame) else {
        return Ok(Vec::new());
    };
    let whole = mask.runs.region(cut.label);
    let same_size = (whole.width, whole.height) == (last.0.width, last.0.height);
    if whole.is_empty() || !same_size {
        return Ok(Vec::new());
    }
    let part = nearer_part(&whole, &last.0, &last.1)?;
    let mut rest = whole;
    rest.subtract(&part);
    let edits = piece_edits(project, cut, frame, mask, &part);
    for (kept, new) in [(&mut last.0, part), (&mut last.1, rest)] {
        if !new.is_empty() {
            *kept = new;
        }
    }
    Ok(edits)
}

/// Returns the edits that give the piece on a frame and the clicks in it to the other label.
fn piece_edits(
    project: &Project,
    cut: &Cut,
    frame: usize,
    mask: &FrameMask,
    part: &Region,
) -> Vec<Edit> {
    let locked = project.locked_on(frame);
    if part.is_empty() || locked.contains(&cut.label) || locked.contains(&cut.into) {
        return Vec::new();
    }
    let mut pixels = mask.runs.decode();
    for (id, _) in pixels
        .ids
        .iter_mut()
        .zip(&part.inside)
        .filter(|(_, inside)| **inside)
    {
        *id = cut.into;
    }
    let confidence = mask.confidence.get(&cut.label).copied();
    let edit = changed(project, frame, mask, RunMask::encode(&pixels), |all| {
        all.extend(confidence.map(|confidence| (cut.into, confidence)));
    });
    edit.into_iter()
        .chain(moved_clicks(project, cut, frame, part))
        .collect()
}

fn moved_clicks(project: &Project, cut: &Cut, frame: usize, part: &Region) -> Vec<Edit> {
    let Some(given) = project.prompts.get(&(frame, cut.label)) else {
        return Vec::new();
    };
    let in_part = |click: &Click| {
        click.include
            && click
                .pixel_in(part.width, part.height)
                .is_some_and(|at| part.inside[at])
    };
    let (moved, kept): (Vec<Click>, Vec<Click>) =
        given.clicks.iter().partition(|click| in_part(click));
    if moved.is_empty() {
        return Vec::new();
    }
    let kept = Prompt {
        clicks: kept,
        size: AnswerSize::Automatic,
        ..given.clone()
    };
    let there = project.prompts.get(&(frame, cut.into)).cloned();
    let mut there = there.unwrap_or_else(|| Prompt {
        corrects: given.corrects,
        ..Prompt::default()
    });
    there.clicks.extend(moved);
    there.size = AnswerSize::Automatic;
    let kept = (!kept.is_empty()).then_some(kept);
    vec![
        Edit::SetPrompt {
            frame,
            label: cut.label,
            prompt: kept,
        },
        Edit::SetPrompt {
            frame,
            label: cut.into,
            prompt: Some(there),
        },
    ]
}

//! Masks as a project holds them, and the edits that change one frame's.

use std::collections::BTreeMap;
use std::sync::Arc;

use anyhow::{Context, Result, ensure};

use ostra_cloud::fuse::naming;
use ostra_masks::{LabelId, LabelMask, PaintRule, RunMask};
use ostra_project::{Edit, FrameMask, MaskOrigin, Project};

/// The edits that give a frame the mask that the user made there: it becomes an anchor, locked labels stay as they are,
/// and a label that the mask shows is there again.
pub fn by_hand(project: &Project, frame: usize, mask: &LabelMask) -> Vec<Edit> {
    let runs = project.with_locks(frame, Arc::new(RunMask::encode(mask)));
    let mut edits = vec![Edit::SetMask {
        frame,
        mask: Some(anchor_of(runs)),
    }];
    edits.extend(project.there_again(&edits));
    edits
}

/// Fails when the label is not there or locked on the frame.
pub fn check_unlocked(project: &Project, frame: usize, label: LabelId) -> Result<()> {
    let name = label_name(project, label)?;
    let locked = project.locked_on(frame).contains(&label);
    ensure!(
        !locked,
        "label '{name}' is locked on frame {frame}; unlock it there first"
    );
    Ok(())
}

/// What becomes of other labels' pixels.
pub fn rule(replace: bool) -> PaintRule {
    if replace {
        PaintRule::Replace
    } else {
        PaintRule::Protect
    }
}

/// A frame's mask as pixels; nothing anywhere when it has none.
pub fn mask_of(project: &Project, frame: usize) -> Result<LabelMask> {
    let of = project.frame(frame)?;
    let mask = project.masks.get(&frame).map(|mask| mask.runs.decode());
    Ok(mask.unwrap_or_else(|| LabelMask::empty(of.width, of.height)))
}

/// The name of a label that must be there.
pub fn label_name(project: &Project, id: LabelId) -> Result<&str> {
    let label = project
        .labels
        .get(id)
        .with_context(|| format!("there is no label {}; make it first", id.0))?;
    Ok(&label.name)
}

/// The mask as an anchor holds it.
pub fn anchor(mask: &LabelMask) -> FrameMask {
    anchor_of(Arc::new(RunMask::encode(mask)))
}

/// Runs as an anchor holds them.
pub fn anchor_of(runs: Arc<RunMask>) -> FrameMask {
    FrameMask {
        runs,
        origin: MaskOrigin::Anchor,
        stale: false,
        confidence: BTreeMap::new(),
    }
}

/// The edit that gives a frame other runs, locked labels as they are; none when nothing changes. An anchor stays one.
pub(crate) fn changed(
    project: &Project,
    frame: usize,
    mask: &FrameMask,
    runs: RunMask,
    set_confidence: impl FnOnce(&mut BTreeMap<LabelId, f32>),
) -> Option<Edit> {
    let runs = project.with_locks(frame, Arc::new(runs));
    if runs == mask.runs {
        return None;
    }
    let mut confidence = mask.confidence.clone();
    if mask.origin == MaskOrigin::Tracked {
        set_confidence(&mut confidence);
    }
    Some(Edit::SetMask {
        frame,
        mask: Some(FrameMask {
            runs,
            confidence,
            ..mask.clone()
        }),
    })
}

/// One line that names frames whose masks are changed without their depth, which cannot be read.
pub(crate) fn without_depth(names: &[&str]) -> Option<String> {
    naming(
        "have a depth that cannot be read, and their masks are changed without it; check their files",
        names,
    )
}

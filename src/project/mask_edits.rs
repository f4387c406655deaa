//! The edits that change the mask of one frame, and conversions of a project's masks.

use std::collections::BTreeMap;
use std::sync::Arc;

use anyhow::{Context, Result, ensure};

use crate::{Edit, FrameMask, MaskOrigin, Project};
use ostra_masks::{LabelId, LabelMask, RunMask};

/// Returns the edits that give a frame a mask made by the user.
///
/// The frame becomes a keyframe. Locked labels keep their pixels, and labels that the mask shows
/// are no longer marked as absent.
pub fn by_hand(project: &Project, frame: usize, mask: &LabelMask) -> Vec<Edit> {
    let runs = project.with_locks(frame, Arc::new(RunMask::encode(mask)));
    let mut edits = vec![Edit::SetMask {
        frame,
        mask: Some(keyframe_of(runs)),
    }];
    edits.extend(project.there_again(&edits));
    edits
}

/// Checks that a label is not locked on a frame.
///
/// # Errors
///
/// Returns an error if the label is missing, or locked there.
pub fn check_unlocked(project: &Project, frame: usize, label: LabelId) -> Result<()> {
    let name = label_name(project, label)?;
    let locked = project.locked_on(frame).contains(&label);
    ensure!(
        !locked,
        "label '{name}' is locked on frame {frame}; unlock it there first"
    );
    Ok(())
}

/// Returns a frame's mask as pixels, without any label if the frame has no mask.
///
/// # Errors
///
/// Returns an error if there is no such frame.
pub fn mask_of(project: &Project, frame: usize) -> Result<LabelMask> {
    let of = project.frame(frame)?;
    let mask = project.masks.get(&frame).map(|mask| mask.runs.decode());
    Ok(mask.unwrap_or_else(|| LabelMask::empty(of.width, of.height)))
}

/// Returns the name of a label.
///
/// # Errors
///
/// Returns an error if there is no such label.
pub fn label_name(project: &Project, id: LabelId) -> Result<&str> {
    let label = project
        .labels
        .get(id)
        .with_context(|| format!("there is no label {}; make it first", id.0))?;
    Ok(&label.name)
}

/// Returns a keyframe with this mask.
pub fn keyframe(mask: &LabelMask) -> FrameMask {
    keyframe_of(Arc::new(RunMask::encode(mask)))
}

/// Returns a keyframe with these runs.
pub fn keyframe_of(runs: Arc<RunMask>) -> FrameMask {
    FrameMask {
        runs,
        origin: MaskOrigin::Keyframe,
        stale: false,
        confidence: BTreeMap::new(),
    }
}

/// Returns the edit that gives a frame other runs, or `None` if nothing changes.
///
/// Locked labels keep their pixels, and a keyframe stays a keyframe.
pub fn changed(
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

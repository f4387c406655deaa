use super::{Action, SessionView, ViewState};
use ostra_masks::{Click, LabelId};
use ostra_project::{FrameMask, MaskOrigin, Project};
use ostra_session::{RangeChange, RangeRequest};

/// Returns `true` if an action changes the selected label over frames without further input.
pub(super) fn is_range_change(action: Action) -> bool {
    use Action as A;
    matches!(
        action,
        A::DeleteRange
            | A::RestoreRange
            | A::AppearsHere
            | A::GoneFromHere
            | A::LockRange
            | A::HideRange
            | A::InterpolateRange
            | A::PasteMask
    )
}

/// Returns the request of an action that changes a label over frames.
///
/// Returns `None` if the action would change nothing.
pub(super) fn range_request(
    action: Action,
    session: &SessionView<'_>,
    view: &ViewState,
) -> Option<RangeRequest> {
    let (project, label) = (session.project, view.label?);
    let meant = view.frames_meant();
    let marks = project.marks_of(label);
    let all = |set: &ostra_frames::FrameSet| {
        set.range_of(meant.0)
            .is_some_and(|range| range.contains(&meant.1))
    };
    let (change, (from, to)) = match action {
        Action::DeleteRange => (RangeChange::Delete, meant),
        Action::RestoreRange => (RangeChange::Restore, meant),
        Action::AppearsHere => (RangeChange::Delete, before_appearing(project, view, label)?),
        Action::GoneFromHere => (RangeChange::Delete, after_going(project, view, label)?),
        Action::LockRange => (
            if all(&marks.locked) {
                RangeChange::Unlock
            } else {
                RangeChange::Lock
            },
            meant,
        ),
        Action::HideRange => (
            if all(&marks.hidden) {
                RangeChange::Show
            } else {
                RangeChange::Hide
            },
            meant,
        ),
        Action::InterpolateRange => (RangeChange::Interpolate, between_keyframes(project, view)?),
        Action::PasteMask => {
            let (copied, frame) = view.copied?;
            let request = RangeRequest {
                labels: vec![copied],
                from: meant.0,
                to: meant.1,
                change: RangeChange::Copy { frame },
                replace: view.track.replace,
            };
            return (meant != (frame, frame)).then_some(request);
        }
        _ => return None,
    };
    Some(RangeRequest {
        labels: vec![label],
        from,
        to,
        change,
        replace: view.track.replace,
    })
}

/// Sets one end of the range, or clears the range.
///
/// Without a range the other end is the shown frame.
pub(super) fn set_range(action: Action, view: &mut ViewState) {
    let frame = view.frame;
    let (from, to) = view.frames_meant();
    view.range = match action {
        Action::RangeFrom => Some((frame, to.max(frame))),
        Action::RangeTo => Some((from.min(frame), frame)),
        _ => None,
    };
}

/// Returns the pixel under the pointer if it has the selected label.
pub(super) fn split_at(session: &SessionView<'_>, view: &ViewState) -> Option<glam::DVec2> {
    let at_px = view.pointer_px?;
    let mask = session.project.masks.get(&view.frame)?;
    Click {
        at_px,
        include: true,
    }
    .pixel_in(mask.runs.width, mask.runs.height)?;
    (super::canvas::id_at(&mask.runs, at_px) == view.label?).then_some(at_px)
}

fn shows(view: &ViewState, frame: usize, mask: &FrameMask, label: LabelId) -> bool {
    mask.origin == MaskOrigin::Keyframe && view.frames.presence.on_frame(frame).contains(&label)
}

/// Returns the frames between the last keyframe with the label and the shown frame, both excluded.
fn before_appearing(project: &Project, view: &ViewState, label: LabelId) -> Option<(usize, usize)> {
    let mut before = project.masks.range(..view.frame).rev();
    let keyframe = before
        .find(|&(&frame, mask)| shows(view, frame, mask, label))
        .map(|(&keyframe, _)| keyframe);
    let first = keyframe.map_or(0, |keyframe| keyframe + 1);
    (first < view.frame).then(|| (first, view.frame - 1))
}

/// Returns the frames from the shown one to the last before the next keyframe with the label.
fn after_going(project: &Project, view: &ViewState, label: LabelId) -> Option<(usize, usize)> {
    let mut after = project.masks.range(view.frame + 1..);
    let keyframe = after
        .find(|&(&frame, mask)| shows(view, frame, mask, label))
        .map(|(&keyframe, _)| keyframe);
    let last = keyframe.unwrap_or(project.frames.len()).checked_sub(1)?;
    (view.frame <= last).then_some((view.frame, last))
}

/// Returns the range, or else the span between the keyframes around the shown frame.
///
/// Both ends are included. The span starts at the shown frame if that is a keyframe.
fn between_keyframes(project: &Project, view: &ViewState) -> Option<(usize, usize)> {
    if view.range.is_some() {
        return view.range.filter(|(from, to)| to - from > 1);
    }
    let is_keyframe = project
        .masks
        .get(&view.frame)
        .is_some_and(|mask| mask.origin == MaskOrigin::Keyframe);
    let (before, after) = project.neighbour_keyframes(view.frame);
    let from = if is_keyframe {
        Some(view.frame)
    } else {
        before
    };
    from.zip(after).filter(|(from, to)| to - from > 1)
}

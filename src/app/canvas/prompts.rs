use std::sync::Arc;

use glam::DVec2;

use crate::{SessionView, ViewState};
use ostra_masks::{AnswerSize, Click, ElasticBorders, LabelId, LabelTree, Prompt, PxBox, RunMask};
use ostra_session::{Command, MoveBorderRequest, PaintRequest, PromptRequest, TraceRequest};

use super::draft::{HeldBorder, Stroke};

/// Adds a click to the selected label.
pub(crate) fn click_at(
    session: &SessionView<'_>,
    view: &mut ViewState,
    at_px: DVec2,
    include: bool,
    out: &mut Vec<Command>,
) {
    if let Some(label) = chosen_label(session, view, out) {
        let request = with_click(session, view, label, Click { at_px, include });
        send(view, request, out);
    }
}

/// Returns the selected label's prompt on the shown frame with one more click.
///
/// A click sends this request, and its preview uses the same one.
pub(super) fn with_click(
    session: &SessionView<'_>,
    view: &ViewState,
    label: LabelId,
    click: Click,
) -> PromptRequest {
    let mut prompt = view.draft.prompt(session.project, view.frame, label);
    prompt.clicks.push(click);
    prompt.size = AnswerSize::Automatic;
    request_of(view, label, prompt)
}

/// Adds a label with the next name of the selected one and includes the object at a position.
pub(super) fn new_object_at(
    session: &SessionView<'_>,
    view: &mut ViewState,
    at_px: DVec2,
    out: &mut Vec<Command>,
) {
    let label = new_label(session, view, out);
    let click = Click {
        at_px,
        include: true,
    };
    let request = with_click(session, view, label, click);
    send(view, request, out);
}

/// Adds a box to the selected label, or to a new one.
pub(super) fn box_of(
    session: &SessionView<'_>,
    view: &mut ViewState,
    corners: [DVec2; 2],
    is_new: bool,
    out: &mut Vec<Command>,
) {
    let [a, b] = corners;
    let label = if is_new {
        Some(new_label(session, view, out))
    } else {
        chosen_label(session, view, out)
    };
    if let Some(label) = label {
        let mut prompt = view.draft.prompt(session.project, view.frame, label);
        prompt.boxes.push(PxBox {
            min_px: a.min(b),
            max_px: a.max(b),
        });
        prompt.size = AnswerSize::Automatic;
        send(view, request_of(view, label, prompt), out);
    }
}

/// Adds a label with the next name of the selected one, as its sibling, and selects it.
fn new_label(session: &SessionView<'_>, view: &mut ViewState, out: &mut Vec<Command>) -> LabelId {
    let tree = &session.project.labels;
    let chosen = view.label.and_then(|label| tree.get(label));
    let parent = chosen.and_then(|label| tree.get(label.parent?));
    let id = tree.next_id();
    // Without a selected label the first name is "object 1", as for a click.
    let before = chosen.map_or("object 0", |label| &label.name);
    out.push(Command::AddLabel {
        name: next_name(tree, before),
        parent: parent.map(|parent| parent.name.clone()),
        color: None,
    });
    view.label = Some(id);
    id
}

/// Returns the first unused name with a number after that of `name`.
fn next_name(tree: &LabelTree, name: &str) -> String {
    let stem = name.trim_end_matches(|c: char| c.is_ascii_digit());
    let number = name[stem.len()..].parse::<u64>().unwrap_or(1);
    let stem = stem.trim_end();
    (1..)
        .map(|step| format!("{stem} {}", number.saturating_add(step)))
        .map(|name| name.trim_start().to_owned())
        .find(|name| tree.by_name(name).is_none())
        .unwrap_or_else(|| stem.to_owned())
}

/// The last answered click, whose answer can get another size.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ResizableAnswer {
    label: LabelId,
    /// Size that was last asked for.
    pub size: AnswerSize,
}

/// Returns the last answered click if it is on the shown frame.
pub(crate) fn resized(session: &SessionView<'_>, view: &ViewState) -> Option<ResizableAnswer> {
    let (_, label) = session
        .last_prompt
        .filter(|&(frame, _)| frame == view.frame)?;
    let prompt = view.draft.prompt(session.project, view.frame, label);
    Some(ResizableAnswer {
        label,
        size: prompt.size,
    })
}

/// Asks for the next smaller or larger answer to the last click.
pub(crate) fn step_size(
    session: &SessionView<'_>,
    view: &mut ViewState,
    up: bool,
    out: &mut Vec<Command>,
) {
    let Some(answer) = resized(session, view) else {
        view.note = "Click on an object first; then its answer can be smaller or larger".into();
        return;
    };
    match answer.size.stepped(up) {
        Some(size) => set_size(session, view, size, out),
        None => {
            let end = if up { "largest" } else { "smallest" };
            view.note = format!("This is the {end} answer to the last click");
        }
    }
}

/// Asks for an answer of a size to the last click.
pub(super) fn set_size(
    session: &SessionView<'_>,
    view: &mut ViewState,
    size: AnswerSize,
    out: &mut Vec<Command>,
) {
    if let Some(ResizableAnswer { label, .. }) = resized(session, view) {
        let mut prompt = view.draft.prompt(session.project, view.frame, label);
        prompt.size = size;
        send(view, request_of(view, label, prompt), out);
    }
}

/// Asks for another answer to the last click, because another segmenter can be used now.
pub(super) fn answer_again(
    session: &SessionView<'_>,
    view: &mut ViewState,
    out: &mut Vec<Command>,
) {
    if let Some(answer) = resized(session, view) {
        set_size(session, view, answer.size, out);
    }
}

/// Removes the selected label's prompt and pixels from the shown frame.
pub(crate) fn clear_label(session: &SessionView<'_>, view: &mut ViewState, out: &mut Vec<Command>) {
    if let Some(label) = view
        .label
        .filter(|&label| session.project.labels.get(label).is_some())
    {
        send(view, request_of(view, label, Prompt::default()), out);
    }
}

/// Sends a finished stroke.
pub(super) fn paint(
    session: &SessionView<'_>,
    view: &mut ViewState,
    stroke: Stroke,
    out: &mut Vec<Command>,
) {
    out.push(Command::Paint(PaintRequest {
        frame: stroke.frame,
        label: stroke.label,
        points_px: stroke.points_px.clone(),
        radius_px: stroke.radius_px,
        erase: stroke.erase,
        replace: true,
        snap: stroke.snap,
    }));
    view.draft.sent_stroke(stroke, session.project);
}

/// Fills the current polygon with the label, or erases inside it.
///
/// A polygon with fewer than three distinct vertices is dropped.
pub(super) fn fill_polygon(
    session: &SessionView<'_>,
    view: &mut ViewState,
    erase: bool,
    out: &mut Vec<Command>,
) {
    let mut points_px = std::mem::take(&mut view.draft.corners);
    points_px.dedup_by(|a, b| a.distance(*b) < 0.5);
    if points_px.len() < 3 {
        return;
    }
    let Some(label) = chosen_label(session, view, out) else {
        return;
    };
    out.push(Command::Paint(PaintRequest {
        frame: view.frame,
        label,
        points_px,
        radius_px: 0.0,
        erase,
        replace: true,
        snap: false,
    }));
}

/// Grabs the selected label's border if it lies within `near_px` of a position.
pub(super) fn hold_border(
    session: &SessionView<'_>,
    view: &mut ViewState,
    pressed_px: DVec2,
    near_px: f64,
) {
    match held_border(session, view, pressed_px, near_px) {
        Ok(held) => view.draft.held = Some(held),
        Err(why) => view.note = why.into(),
    }
}

fn held_border(
    session: &SessionView<'_>,
    view: &ViewState,
    pressed_px: DVec2,
    near_px: f64,
) -> Result<HeldBorder, &'static str> {
    const HINT: &str = "Press on the border of the selected label and drag it to the right place";
    let frame = view.frame;
    let (label, mask) = view
        .label
        .zip(session.project.masks.get(&frame))
        .ok_or(HINT)?;
    if view.hidden.contains(&label) {
        return Err("The selected label is hidden; show it to move its border");
    }
    if session.project.locked_on(frame).contains(&label) {
        return Err("The selected label is locked on this frame; unlock it first");
    }
    let borders = ElasticBorders::of(&mask.runs.decode().region(label));
    let near = borders
        .nearest(pressed_px)
        .filter(|from| from.distance(pressed_px) <= near_px);
    let from_px = near.ok_or(HINT)?;
    Ok(HeldBorder {
        frame,
        label,
        borders,
        from_px,
        pressed_px,
        of: Arc::clone(&mask.runs),
    })
}

/// Moves the grabbed border to the pointer.
pub(super) fn move_border(held: &HeldBorder, pointer_px: DVec2, out: &mut Vec<Command>) {
    let HeldBorder {
        frame,
        label,
        from_px,
        ..
    } = *held;
    if let Some(to_px) = held.to_px(pointer_px) {
        out.push(Command::MoveBorder(MoveBorderRequest {
            frame,
            label,
            from_px,
            to_px,
            replace: true,
        }));
    }
}

/// Traces the thin structure through the points so far.
///
/// A single point is kept until the next one follows.
pub(super) fn trace_thin(session: &SessionView<'_>, view: &mut ViewState, out: &mut Vec<Command>) {
    let mut points_px = view.draft.corners.clone();
    points_px.dedup_by(|a, b| a.distance(*b) < 1.0);
    if points_px.len() < 2 {
        view.note = "A stem or wire needs at least two points: click along it".into();
        return;
    }
    let Some(label) = chosen_label(session, view, out) else {
        return;
    };
    view.draft.corners.clear();
    out.push(Command::Trace(TraceRequest {
        frame: view.frame,
        label,
        points_px,
        replace: true,
    }));
}

/// Returns the selected label; the first click in a project without labels creates one.
pub(super) fn chosen_label(
    session: &SessionView<'_>,
    view: &mut ViewState,
    out: &mut Vec<Command>,
) -> Option<LabelId> {
    let labels = &session.project.labels;
    let is_added = |label: LabelId| {
        let is_add = |command: &Command| matches!(command, Command::AddLabel { .. });
        label == labels.next_id() && out.iter().any(is_add)
    };
    let known = |label: &LabelId| labels.get(*label).is_some() || is_added(*label);
    if let Some(label) = view.label.filter(known) {
        return Some(label);
    }
    if session.project.labels.iter().next().is_some() {
        return None;
    }
    let label = session.project.labels.next_id();
    out.push(Command::AddLabel {
        name: format!("object {}", label.0),
        parent: None,
        color: None,
    });
    view.label = Some(label);
    Some(label)
}

/// Returns the box around the selected label and its child labels on the shown frame.
pub(crate) fn label_extent(session: &SessionView<'_>, view: &ViewState) -> Option<PxBox> {
    let label = view.label?;
    let extents = session.project.masks.get(&view.frame)?.runs.extents();
    let below = session.project.labels.descendants(label);
    let found = std::iter::once(label)
        .chain(below)
        .filter_map(|id| extents.get(&id));
    let boxes = found.map(|extent| PxBox {
        min_px: DVec2::from(extent.min.map(f64::from)),
        max_px: DVec2::from(extent.max.map(f64::from)) + 1.0,
    });
    boxes.reduce(|a, b| PxBox {
        min_px: a.min_px.min(b.min_px),
        max_px: a.max_px.max(b.max_px),
    })
}

/// Returns the label at an image position.
pub(crate) fn id_at(mask: &RunMask, at_px: DVec2) -> LabelId {
    if at_px.x < 0.0
        || at_px.y < 0.0
        || at_px.x >= f64::from(mask.width)
        || at_px.y >= f64::from(mask.height)
    {
        return LabelId::NONE;
    }
    let mut left = at_px.y as u64 * u64::from(mask.width) + at_px.x as u64;
    for &(id, length) in &mask.runs {
        if left < u64::from(length) {
            return id;
        }
        left -= u64::from(length);
    }
    LabelId::NONE
}

fn request_of(view: &ViewState, label: LabelId, prompt: Prompt) -> PromptRequest {
    PromptRequest {
        frame: view.frame,
        label,
        prompt,
        segmenter: view.segmenter,
    }
}

fn send(view: &mut ViewState, request: PromptRequest, out: &mut Vec<Command>) {
    view.answer.forget();
    let sent = request.prompt.clone();
    view.draft.sent(request.frame, request.label, sent);
    out.push(Command::Prompt(request));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn next_name_counts_on_from_the_name_of_the_selected_label() {
        let mut tree = LabelTree::default();
        for (id, name) in [(1, "leaf"), (2, "leaf 3"), (3, "leaf 4"), (4, "object 1")] {
            let label = ostra_masks::Label {
                id: LabelId(id),
                name: name.into(),
                color: [0; 3],
                parent: None,
            };
            tree.set(label).unwrap();
        }
        assert_eq!(next_name(&tree, "leaf"), "leaf 2");
        assert_eq!(next_name(&tree, "leaf 3"), "leaf 5");
        assert_eq!(next_name(&tree, "object 1"), "object 2");
        assert_eq!(next_name(&tree, "7"), "8");
    }

    #[test]
    fn id_at_decodes_runs() {
        let mask = RunMask {
            width: 4,
            height: 2,
            runs: vec![(LabelId(0), 3), (LabelId(7), 3), (LabelId(2), 2)],
        };
        assert_eq!(id_at(&mask, DVec2::new(3.9, 0.5)), LabelId(7));
        assert_eq!(id_at(&mask, DVec2::new(2.0, 1.0)), LabelId(2));
        assert_eq!(id_at(&mask, DVec2::new(4.0, 0.0)), LabelId::NONE);
    }
}

use egui::{Key, Modifiers, PointerButton, Pos2, Response, Ui};
use glam::DVec2;

use super::draft::{Stroke, Tool};
use super::map::CanvasMap;
use super::prompts::{
    box_of, chosen_label, click_at, fill_polygon, hold_border, move_border, new_object_at, paint,
    step_size, trace_thin,
};
use crate::pointer::{PrimaryEnd, pointer_path, primary_ends};
use crate::{SessionView, ViewState};
use ostra_session::Command;

/// Pointer on the image in one frame of the window.
pub(super) struct CanvasPointer<'a> {
    pub ui: &'a Ui,
    pub response: &'a Response,
    pub map: &'a CanvasMap,
}

impl CanvasPointer<'_> {
    /// Returns the image position of the pointer while it interacts with the image.
    fn position(&self) -> Option<DVec2> {
        self.response
            .interact_pointer_pos()
            .map(|at| self.map.to_px(at))
    }

    /// Follows a drag with the primary button from its press on the image to its release.
    ///
    /// `pressed` is where the button was pressed, while it is down.
    fn follow_drag(&self, pressed: &mut Option<Pos2>) -> ImageDrag {
        let ends = primary_ends(self.ui);
        let is_whole = ends
            .iter()
            .any(|end| matches!(end, PrimaryEnd::Released(_)));
        let is_ours = |at: Pos2| {
            let is_here =
                || is_whole && self.ui.ctx().layer_id_at(at) == Some(self.response.layer_id);
            self.response.rect.contains(at)
                && (self.response.is_pointer_button_down_on() || is_here())
        };
        let mut done = None;
        for end in ends {
            match end {
                PrimaryEnd::Pressed(at) => *pressed = Some(at).filter(|&at| is_ours(at)),
                PrimaryEnd::Released(to) => done = pressed.take().map(|from| (from, to)).or(done),
            }
        }
        if let Some((from, to)) = done {
            return if self.response.clicked() || from.distance(to) < DRAG_POINTS {
                ImageDrag::None
            } else {
                ImageDrag::Done(self.map.to_px(from), self.map.to_px(to))
            };
        }
        match *pressed {
            Some(from) if self.response.dragged_by(PointerButton::Primary) => {
                ImageDrag::From(self.map.to_px(from))
            }
            Some(_) if self.ui.input(|input| input.pointer.primary_down()) => ImageDrag::None,
            // The release did not reach the window.
            _ => {
                *pressed = None;
                ImageDrag::None
            }
        }
    }
}

/// Movement below which a press and a release are no drag, in screen points.
const DRAG_POINTS: f32 = 3.0;

/// A drag over the image, in image pixels.
enum ImageDrag {
    None,
    /// The button was pressed here and the pointer has moved.
    From(DVec2),
    /// The button was pressed and released here.
    Done(DVec2, DVec2),
}

/// Translates pointer input on the image into commands.
pub(super) fn canvas_input(
    pointer: &CanvasPointer<'_>,
    session: &SessionView<'_>,
    view: &mut ViewState,
    out: &mut Vec<Command>,
) {
    wheel(pointer, session, view, out);
    if pan(pointer, view) {
        view.draft.drop_half_made();
        return;
    }
    match view.tool {
        Tool::Click => click_tool(pointer, session, view, out),
        Tool::Brush | Tool::Eraser => brush_tool(pointer, session, view, out),
        Tool::Polygon | Tool::Stem => corners_tool(pointer, session, view, out),
        Tool::Border => border_tool(pointer, session, view, out),
    }
}

/// Turn of the wheel that steps to another size of the answer, in screen points.
const SIZE_STEP: f32 = 30.0;

/// Handles the wheel: zooms at the pointer, with Shift sets the brush size, and with Alt the size
/// of the answer to the last click.
fn wheel(
    pointer: &CanvasPointer<'_>,
    session: &SessionView<'_>,
    view: &mut ViewState,
    out: &mut Vec<Command>,
) {
    let CanvasPointer { ui, response, map } = pointer;
    let Some(at) = response.hover_pos() else {
        return;
    };
    let (scroll, pinch, shift, alt) = ui.input(|i| {
        let Modifiers { shift, alt, .. } = i.modifiers;
        (i.smooth_scroll_delta(), i.zoom_delta(), shift, alt)
    });
    let turn = scroll.x + scroll.y;
    if alt && view.tool == Tool::Click {
        // What is left of a step is dropped when the wheel stops.
        view.answer.turn = if turn == 0.0 {
            0.0
        } else {
            view.answer.turn + turn
        };
        if view.answer.turn.abs() >= SIZE_STEP {
            step_size(session, view, view.answer.turn > 0.0, out);
            view.answer.turn = 0.0;
        }
        return;
    }
    view.answer.turn = 0.0;
    if shift && matches!(view.tool, Tool::Brush | Tool::Eraser) {
        let size = view.prefs.brush_px * f64::from((turn / 200.0).exp());
        view.prefs.brush_px = size.clamp(0.5, 500.0);
    } else if turn != 0.0 || pinch != 1.0 {
        view.zoom.zoom_at(map, at, (turn / 200.0).exp() * pinch);
    }
}

/// Pans by middle drag or Space + drag; returns `true` if that captures the pointer.
fn pan(pointer: &CanvasPointer<'_>, view: &mut ViewState) -> bool {
    let CanvasPointer { ui, response, map } = pointer;
    let space = response.hovered() && ui.input(|i| i.key_down(Key::Space));
    let dragging = response.dragged_by(PointerButton::Middle)
        || (space && response.dragged_by(PointerButton::Primary));
    if dragging {
        view.zoom.pan(map, response.drag_delta());
        ui.ctx().set_cursor_icon(egui::CursorIcon::Grabbing);
    } else if space {
        ui.ctx().set_cursor_icon(egui::CursorIcon::Grab);
    }
    dragging || space
}

fn click_tool(
    pointer: &CanvasPointer<'_>,
    session: &SessionView<'_>,
    view: &mut ViewState,
    out: &mut Vec<Command>,
) {
    let CanvasPointer { ui, response, map } = pointer;
    let at = pointer.position();
    let is_new = ui.input(|i| i.modifiers.command);
    if response.clicked() || response.secondary_clicked() {
        match at.and_then(|at| map.inside(at)) {
            Some(at_px) if is_new && response.clicked() => {
                new_object_at(session, view, at_px, out);
            }
            Some(at_px) => click_at(session, view, at_px, response.clicked(), out),
            None => {}
        }
        return;
    }
    match pointer.follow_drag(&mut view.draft.pressed) {
        ImageDrag::None => view.draft.box_from = None,
        ImageDrag::From(from) => view.draft.box_from = Some(map.clamped(from)),
        ImageDrag::Done(from, to) => {
            view.draft.box_from = None;
            let (from, to) = (map.clamped(from), map.clamped(to));
            if (to - from).abs().min_element() >= 2.0 {
                box_of(session, view, [from, to], is_new, out);
            }
        }
    }
}

fn brush_tool(
    pointer: &CanvasPointer<'_>,
    session: &SessionView<'_>,
    view: &mut ViewState,
    out: &mut Vec<Command>,
) {
    const BUTTONS: [PointerButton; 2] = [PointerButton::Primary, PointerButton::Secondary];
    let CanvasPointer { ui, response, map } = pointer;
    let (pressed, is_over, ctrl) = ui.input(|i| {
        let down = BUTTONS
            .into_iter()
            .any(|button| i.pointer.button_down(button));
        let pressed = BUTTONS.map(|button| i.pointer.button_pressed(button));
        let is_let_go = BUTTONS
            .into_iter()
            .any(|button| i.pointer.button_released(button))
            && pressed == [false; 2];
        (
            pressed,
            is_let_go || !down || !i.pointer.has_pointer(),
            i.modifiers.command,
        )
    });
    let places = pointer_path(ui, &BUTTONS);
    if pressed.contains(&true) {
        // A previous stroke may have ended within this frame, or without a release event.
        end_stroke(session, view, out);
        let is_tap = response.clicked() || response.secondary_clicked();
        let is_swift = is_over && response.contains_pointer();
        if response.is_pointer_button_down_on() || is_tap || is_swift {
            let erase = view.tool == Tool::Eraser || pressed[1] || ctrl;
            let Some(label) = chosen_label(session, view, out) else {
                return;
            };
            let (radius_px, snap) = (view.prefs.brush_px, view.prefs.snap);
            let begin = places
                .first()
                .map(|&at| map.to_px(at))
                .or_else(|| pointer.position());
            let points_px = Vec::from_iter(begin);
            view.draft.stroke = Some(Stroke {
                frame: view.frame,
                label,
                erase,
                points_px,
                radius_px,
                snap,
            });
        }
    }
    if let Some(stroke) = &mut view.draft.stroke {
        for at in places.into_iter().map(|at| map.to_px(at)) {
            if stroke
                .points_px
                .last()
                .is_none_or(|last| last.distance(at) >= 0.5)
            {
                stroke.points_px.push(at);
            }
        }
    }
    if is_over {
        end_stroke(session, view, out);
    }
}

fn end_stroke(session: &SessionView<'_>, view: &mut ViewState, out: &mut Vec<Command>) {
    if let Some(stroke) = view.draft.stroke.take() {
        paint(session, view, stroke, out);
    }
}

/// Distance within which a press grabs a border, in screen points.
const HOLD_POINTS: f64 = 12.0;

/// Drags a border of the selected label.
fn border_tool(
    pointer: &CanvasPointer<'_>,
    session: &SessionView<'_>,
    view: &mut ViewState,
    out: &mut Vec<Command>,
) {
    let CanvasPointer { response, map, .. } = pointer;
    let reach_px = HOLD_POINTS / f64::from(map.scale);
    match pointer.follow_drag(&mut view.draft.pressed) {
        ImageDrag::From(from) if response.drag_started_by(PointerButton::Primary) => {
            hold_border(session, view, from, reach_px);
        }
        ImageDrag::None | ImageDrag::From(_) => {}
        ImageDrag::Done(from, to) => {
            // A drag within a slow frame has no start of its own.
            if !response.drag_stopped_by(PointerButton::Primary) {
                hold_border(session, view, from, reach_px);
            }
            if let Some(held) = view.draft.held.take() {
                move_border(&held, to, out);
            }
        }
    }
}

/// Adds a vertex per click to the polygon or thin structure.
///
/// A polygon may also be drawn freehand.
fn corners_tool(
    pointer: &CanvasPointer<'_>,
    session: &SessionView<'_>,
    view: &mut ViewState,
    out: &mut Vec<Command>,
) {
    let CanvasPointer { ui, response, map } = pointer;
    let pressed = |key| response.hovered() && ui.input(|i| i.key_pressed(key));
    let mut finished = response.double_clicked() || pressed(Key::Enter);
    if response.clicked()
        && !finished
        && let Some(at) = pointer.position()
    {
        let near_start = |first: &DVec2| map.to_screen(*first).distance(map.to_screen(at)) < 8.0;
        let corners = &mut view.draft.corners;
        if view.tool == Tool::Polygon
            && corners.len() >= 3
            && corners.first().is_some_and(near_start)
        {
            finished = true;
        } else {
            corners.push(map.clamped(at));
        }
    }
    if response.secondary_clicked() || pressed(Key::Backspace) {
        view.draft.corners.pop();
    }
    if view.tool == Tool::Polygon {
        finished |= lasso(pointer, view);
    }
    match (finished, view.tool) {
        (true, Tool::Stem) => trace_thin(session, view, out),
        (true, _) => fill_polygon(session, view, ui.input(|i| i.modifiers.command), out),
        (false, _) => {}
    }
}

/// Movement up to which a freehand outline counts as a click, in screen points.
const LASSO_POINTS: f32 = 8.0;

/// Records a freehand outline while the button is held and no vertex is set.
///
/// Returns `true` once the button is released after an outline, which then replaces the vertices.
fn lasso(pointer: &CanvasPointer<'_>, view: &mut ViewState) -> bool {
    let CanvasPointer { ui, response, map } = pointer;
    let (pressed, down) = ui.input(|i| (i.pointer.primary_pressed(), i.pointer.primary_down()));
    if pressed && response.is_pointer_button_down_on() && view.draft.corners.is_empty() {
        view.draft.lasso = Some(Vec::new());
    }
    let Some(line) = &mut view.draft.lasso else {
        return false;
    };
    for at in pointer_path(ui, &[PointerButton::Primary])
        .into_iter()
        .map(|at| map.clamped(map.to_px(at)))
    {
        if line.last().is_none_or(|last| last.distance(at) >= 0.5) {
            line.push(at);
        }
    }
    if down {
        return false;
    }
    let line = view.draft.lasso.take().unwrap_or_default();
    let is_far = |at: &DVec2| map.to_screen(*at).distance(map.to_screen(line[0])) > LASSO_POINTS;
    let is_drawn = !response.clicked() && line.iter().any(is_far);
    if is_drawn {
        view.draft.corners = line;
    }
    is_drawn
}

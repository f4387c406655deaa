use egui::{
    Color32, DragValue, Mesh, PointerButton, Pos2, Rect, Response, Shape, Slider, Stroke, Ui, Vec2,
};
use glam::{DVec2, Vec3};

use super::scene_content::SceneViewport;
use super::scene_picks::VisibleScene;
use super::scene_tools::{SceneSelect, SelectShape};
use crate::pointer::pointer_path;
use crate::tooltips::{action_button, add_explained};
use crate::{Action, SessionView, ViewState};
use ostra_cloud::select::{SeenRegion, SelectStep, Selection};
use ostra_masks::LabelId;
use ostra_project::ResultKind;

const COLOR: Color32 = Color32::from_rgb(255, 80, 205);
/// Maximum number of marked points. Of more, an even sample is marked.
const MARKED: usize = 20_000;

/// Reason for disabled controls while no points are selected.
const NOTHING_SELECTED: &str = "Draw around points first";

const SHAPES: [(SelectShape, &str, &str); 3] = [
    (SelectShape::Lasso, "Lasso", "Drag around points"),
    (SelectShape::Box, "Box", "Drag from corner to corner"),
    (SelectShape::Brush, "Brush", "Drag over points"),
];

/// Draws the outline and selected points over the 3-D view.
///
/// While the side panel is hidden, the selection panel is a window over the view.
pub(super) fn chosen_ui(
    ui: &Ui,
    viewport: &SceneViewport,
    session: &SessionView<'_>,
    view: &mut ViewState,
    actions: &mut Vec<Action>,
) {
    let rect = viewport.rect;
    let chosen = session
        .chosen
        .filter(|_| !view.scene_select.steps.is_empty())
        .and_then(Result::ok);
    if let (Some(chosen), Some(cloud)) = (chosen, session.cloud) {
        mark(ui, viewport, &cloud.positions, chosen);
    }
    draw_outline(ui, rect, &view.scene_select);
    if !view.scene_select.in_hand || view.steps.is_docked {
        return;
    }
    let window = egui::Window::new("Select points")
        .title_bar(false)
        .resizable(false)
        .default_width(240.0);
    let window = window
        .pivot(egui::Align2::LEFT_BOTTOM)
        .default_pos(rect.left_bottom() + Vec2::new(8.0, -8.0));
    window.constrain_to(rect).show(ui.ctx(), |ui| {
        selection_ui(ui, session, view, actions);
    });
}

/// Draws the selection of points: shape, count, changes, and corrections of the labels.
pub(crate) fn selection_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    actions: &mut Vec<Action>,
) {
    shape_ui(ui, &mut view.scene_select);
    ui.horizontal_wrapped(|ui| count_ui(ui, session, &mut view.scene_select));
    steps_ui(ui, session, view);
    ui.separator();
    correct_ui(ui, session, view, actions);
}

/// Marks the selected points, including hidden ones behind others.
fn mark(ui: &Ui, viewport: &SceneViewport, positions: &[Vec3], chosen: &Selection) {
    let SceneViewport { rect, camera, .. } = viewport;
    let scale = ui.pixels_per_point();
    let mut mesh = Mesh::default();
    for &point in chosen
        .points
        .iter()
        .step_by(chosen.points.len().div_ceil(MARKED).max(1))
    {
        let Some((at, _)) = positions
            .get(point as usize)
            .and_then(|&x| camera.project(x))
        else {
            continue;
        };
        let at = rect.min + Vec2::new(at.x, at.y) / scale;
        if rect.contains(at) {
            mesh.add_colored_rect(Rect::from_center_size(at, Vec2::splat(2.0)), COLOR);
        }
    }
    ui.painter().with_clip_rect(*rect).add(Shape::mesh(mesh));
}

fn draw_outline(ui: &Ui, rect: Rect, select: &SceneSelect) {
    let (painter, stroke) = (ui.painter().with_clip_rect(rect), Stroke::new(1.5, COLOR));
    let outline = select.outline();
    if select.shape == SelectShape::Brush {
        if let Some(at) = ui
            .input(|input| input.pointer.hover_pos())
            .filter(|at| select.in_hand && rect.contains(*at))
        {
            painter.circle_stroke(at, select.brush, stroke);
        }
        let wide = Stroke::new(2.0 * select.brush, COLOR.gamma_multiply(0.3));
        painter.add(Shape::line(outline, wide));
    } else if outline.len() > 1 {
        painter.extend(Shape::dashed_line(&closed(outline), stroke, 6.0, 4.0));
    }
}

fn closed(mut outline: Vec<Pos2>) -> Vec<Pos2> {
    outline.extend(outline.first().copied());
    outline
}

fn shape_ui(ui: &mut Ui, select: &mut SceneSelect) {
    ui.horizontal(|ui| {
        for (shape, text, tip) in SHAPES {
            let tip = format!("{tip}; Shift adds, Ctrl removes. The right button orbits");
            ui.selectable_value(&mut select.shape, shape, text)
                .on_hover_text(tip);
        }
    });
    if select.shape == SelectShape::Brush {
        let slider = Slider::new(&mut select.brush, 2.0..=100.0).show_value(false);
        ui.add(slider)
            .on_hover_text("Radius of the brush")
            .accessible_name("Selection brush size");
    }
}

/// Returns `true` if there is a cloud, even if it is not loaded yet.
fn has_cloud(session: &SessionView<'_>) -> bool {
    session.cloud.is_some() || session.project.results.contains_key(&ResultKind::Cloud)
}

/// Shows the number of selected points and the undo button.
fn count_ui(ui: &mut Ui, session: &SessionView<'_>, select: &mut SceneSelect) {
    let text = match session.chosen.filter(|_| !select.steps.is_empty()) {
        None if !has_cloud(session) => "There is no cloud to choose from; fuse first".to_owned(),
        None if select.steps.is_empty() => "Draw around visible points".to_owned(),
        None => "Selecting…".to_owned(),
        Some(Err(why)) => why.to_owned(),
        Some(Ok(chosen)) => match (chosen.points.len(), chosen.pieces) {
            (0, _) => "No visible point there".to_owned(),
            (1, _) => "1 point".to_owned(),
            (points, 1) => format!("{points} points in one part"),
            (points, pieces) => format!("{points} points in {pieces} parts"),
        },
    };
    ui.label(text);
    let reason = select.steps.is_empty().then_some(NOTHING_SELECTED);
    let back = egui::Button::new("Undo selection");
    if add_explained(ui, back, "Undo the last change of the selection", reason).clicked() {
        select.steps.pop();
    }
}

/// Draws the controls that grow or reduce the selection.
fn steps_ui(ui: &mut Ui, session: &SessionView<'_>, view: &mut ViewState) {
    let none = (!has_chosen(session, view)).then_some(NOTHING_SELECTED);
    let (select, label) = (&mut view.scene_select, view.label);
    ui.horizontal(|ui| {
        let grow = egui::Button::new("Grow");
        if add_explained(ui, grow, "Add similar points nearby", none).clicked() {
            select.steps.push(SelectStep::Grow(select.likeness));
        }
        let angle = DragValue::new(&mut select.likeness.normal_deg)
            .range(0.0..=180.0)
            .suffix("°")
            .max_decimals(0);
        let tip = "Largest angle between the normals of neighbouring points";
        add_explained(ui, angle, tip, none).accessible_name("Angle of normals");
        let color = DragValue::new(&mut select.likeness.color)
            .range(0.0..=100.0)
            .prefix("ΔE ")
            .max_decimals(0);
        let tip = "Largest colour difference from the starting points";
        ui.name_inputs("Difference of colour", |ui| {
            add_explained(ui, color, tip, none)
        });
    });
    let pieces = session
        .chosen
        .and_then(Result::ok)
        .map_or(1, |chosen| chosen.pieces.max(1));
    ui.horizontal(|ui| {
        let single = (pieces < 2).then_some("The selected points are one part");
        let tip = "Split the points into connected parts and keep one";
        let keep = egui::Button::new("Keep part");
        if add_explained(ui, keep, tip, none.or(single)).clicked() {
            select
                .steps
                .push(SelectStep::Piece(select.piece.clamp(1, pieces) - 1));
            select.piece = 1;
        }
        let piece = DragValue::new(&mut select.piece)
            .range(1..=pieces)
            .speed(0.05);
        ui.name_inputs("Part", |ui| {
            add_explained(ui, piece, "1 is the largest", none)
        });
        ui.weak(format!("of {pieces}"));
    });
    let name = label
        .and_then(|label| session.project.labels.get(label))
        .map_or("label", |label| label.name.as_str());
    let no_label = label.is_none().then_some("Select a label first");
    let only = egui::Button::new(format!("Only {name}"));
    let tip = "Keep only points of the selected label";
    if add_explained(ui, only, tip, none.or(no_label)).clicked() {
        select.steps.extend(label.map(SelectStep::Only));
    }
}

/// Draws the controls that assign or clear the label of the selected points.
fn correct_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    actions: &mut Vec<Action>,
) {
    ui.checkbox(&mut view.scene_select.as_keyframes, "As keyframes")
        .on_hover_text("Make the changed frames keyframes, which tracking does not overwrite");
    let label = view
        .label
        .and_then(|label| session.project.labels.get(label));
    let text = label.map_or("Assign".to_owned(), |label| {
        format!("Assign to {}", label.name)
    });
    let shortcuts = &view.prefs.shortcuts;
    ui.horizontal(|ui| {
        for (action, text) in [
            (Action::AssignChosen, text.as_str()),
            (Action::ClearChosen, "Clear"),
        ] {
            let reason = action.unavailable(session, view);
            if action_button(ui, shortcuts, action, text, reason).clicked() {
                actions.push(action);
            }
        }
    });
}

/// Movement up to which a drag counts as a click, in screen points.
const CLICK: f32 = 6.0;

/// Draws an outline with the primary button and selects the points in it on release.
///
/// Shift adds to the selection, Ctrl or Alt removes from it, else the selection is replaced.
pub(super) fn choose_by_hand(
    ui: &Ui,
    response: &Response,
    view: &mut ViewState,
    seen: &VisibleScene,
) {
    if !follow(ui, response, &mut view.scene_select.drawn) {
        return;
    }
    let (scale, modifiers) = (ui.pixels_per_point(), ui.input(|input| input.modifiers));
    let remove = modifiers.alt || modifiers.command || modifiers.ctrl;
    let region = region(view, response.rect, scale, seen, remove);
    let select = &mut view.scene_select;
    if !remove && !modifiers.shift {
        select.steps.clear();
    }
    select.steps.push(SelectStep::Seen(region));
    select.drawn.clear();
    select.piece = 1;
}

/// Adds the pointer's path to the outline; returns `true` when the outline is finished.
///
/// The buttons are read directly, because a response reports a drag one frame late.
fn follow(ui: &Ui, response: &Response, drawn: &mut Vec<Pos2>) -> bool {
    let (down, pressed) = ui.input(|input| {
        (
            input.pointer.primary_down(),
            input.pointer.primary_pressed(),
        )
    });
    let held = down && response.is_pointer_button_down_on();
    let mut places = pointer_path(ui, &[PointerButton::Primary]).into_iter();
    if held && pressed {
        *drawn = places.next().into_iter().collect();
    }
    for at in places {
        if drawn.last().is_some_and(|last| last.distance(at) > 1.0) {
            drawn.push(at);
        }
    }
    let is_click = drawn.iter().all(|at| at.distance(drawn[0]) <= CLICK);
    if !held && is_click {
        drawn.clear();
    }
    !held && !is_click
}

fn region(
    view: &ViewState,
    rect: Rect,
    scale: f32,
    seen: &VisibleScene,
    remove: bool,
) -> SeenRegion {
    let select = &view.scene_select;
    let in_image = |at: Pos2| {
        let at = (at - rect.min) * scale;
        DVec2::new(f64::from(at.x), f64::from(at.y))
    };
    let radius_px = if select.shape == SelectShape::Brush {
        f64::from(select.brush * scale)
    } else {
        0.0
    };
    let hidden: Vec<LabelId> = view.hidden.iter().copied().collect();
    let points_px = select.outline().into_iter().map(in_image).collect();
    let scene = &view.scene;
    let (isolated, uncertain_below, cube_from_world) = (
        scene.isolated,
        scene.uncertain_below,
        seen.clip.cube_from_world(),
    );
    SeenRegion {
        eye: seen.camera.eye(),
        points_px,
        radius_px,
        remove,
        hidden,
        isolated,
        uncertain_below,
        cube_from_world,
    }
}

/// Returns `true` if points are selected and can be corrected.
pub(crate) fn has_chosen(session: &SessionView<'_>, view: &ViewState) -> bool {
    let any = session
        .chosen
        .is_some_and(|chosen| chosen.is_ok_and(|chosen| !chosen.points.is_empty()));
    any && !view.scene_select.steps.is_empty()
}

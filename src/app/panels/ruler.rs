use egui::{ComboBox, DragValue, Key, Ui};

use super::measure_settings::unit_ui;
use super::scene_tools::{Ruler, RulerKind};
use crate::tooltips::action_button;
use crate::{Action, SessionView, ViewState};
use ostra_cloud::measure::{Dimension, LengthUnit};

/// Draws the measured value of the ruler and the field for the known length.
pub(super) fn ruler_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    actions: &mut Vec<Action>,
) {
    if !view.ruler.in_hand {
        return;
    }
    kind_ui(ui, &mut view.ruler);
    if view.ruler.kind == RulerKind::Length {
        unit_ui(ui, "Ruler unit", &mut view.measures.unit, session);
    }
    match view.ruler.value() {
        Some((value, dimension)) => {
            let unit = view.measures.unit.unwrap_or(session.unit);
            ui.label(unit.text(value, dimension))
                .on_hover_text(tip(&view.ruler, unit));
        }
        None => {
            ui.weak(view.ruler.hint());
        }
    }
    undo_ui(ui, &mut view.ruler);
    let has_cameras = session
        .project
        .frames
        .iter()
        .any(|frame| frame.posed_camera().is_some());
    if has_cameras && view.ruler.kind == RulerKind::Length && view.ruler.points.len() == 2 {
        scale_ui(ui, view, actions);
    }
}

fn kind_ui(ui: &mut Ui, ruler: &mut Ruler) {
    let kinds = [
        (
            RulerKind::Length,
            "Distance",
            "Measure the length of the line through two or more points",
        ),
        (
            RulerKind::Angle,
            "Angle",
            "Measure the angle at the second of three points",
        ),
    ];
    for (kind, text, tip) in kinds {
        if ui
            .selectable_label(ruler.kind == kind, text)
            .on_hover_text(tip)
            .clicked()
            && ruler.kind != kind
        {
            (ruler.kind, ruler.points) = (kind, Vec::new());
        }
    }
}

fn tip(ruler: &Ruler, unit: LengthUnit) -> String {
    let steps = ruler
        .points
        .windows(2)
        .map(|pair| f64::from(pair[0].distance(pair[1])));
    let steps: Vec<String> = steps
        .map(|step| unit.text(step, Dimension::Length))
        .collect();
    format!(
        "Through {} points of the cloud: {}",
        ruler.points.len(),
        steps.join(", ")
    )
}

fn undo_ui(ui: &mut Ui, ruler: &mut Ruler) {
    if ruler.points.is_empty() {
        return;
    }
    let by_key =
        !ui.ctx().text_edit_focused() && ui.input(|input| input.key_pressed(Key::Backspace));
    if ui
        .button("Undo click")
        .on_hover_text("Remove the last point (Backspace or right click)")
        .clicked()
        || by_key
    {
        ruler.undo_click();
    }
    if ui
        .button("Clear")
        .on_hover_text("Remove all points")
        .clicked()
    {
        ruler.points.clear();
    }
}

fn scale_ui(ui: &mut Ui, view: &mut ViewState, actions: &mut Vec<Action>) {
    ui.label("is really");
    let length = DragValue::new(&mut view.ruler.length)
        .range(0.0..=1e9)
        .speed(0.01)
        .max_decimals(6);
    ui.name_inputs("Known length", |ui| ui.add(length))
        .on_hover_text("True distance of the two points");
    let unit = &mut view.ruler.length_unit;
    let choice = ComboBox::from_id_salt("known length unit")
        .selected_text(unit.sign())
        .width(50.0)
        .show_ui(ui, |ui| {
            for metric in LengthUnit::METRIC {
                ui.selectable_value(unit, metric, metric.sign());
            }
        });
    choice
        .response
        .on_hover_text("Unit of the known length")
        .accessible_name("Unit of the known length");
    let possible = view.ruler.command().is_some();
    if action_button(
        ui,
        &view.prefs.shortcuts,
        Action::SetScale,
        "Set scale",
        possible,
    )
    .clicked()
    {
        actions.push(Action::SetScale);
    }
}

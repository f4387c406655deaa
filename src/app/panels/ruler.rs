use egui::{ComboBox, DragValue, Key, Rect, Ui};

use super::measure_settings::unit_ui;
use super::scene_tools::{Ruler, RulerKind};
use crate::tooltips::{action_button, add_explained};
use crate::{Action, SessionView, ViewState};
use ostra_cloud::measure::{Dimension, LengthUnit};
use ostra_frames::Frame;

/// Width of the measured value, so that nothing moves when it changes.
const VALUE_WIDTH: f32 = 150.0;

/// Draws the measured value of the ruler, and below it the fields that set the scale.
///
/// Both rows are there before the first click, so that the bar does not grow under the pointer.
pub(super) fn ruler_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    actions: &mut Vec<Action>,
) {
    if !view.ruler.in_hand {
        return;
    }
    ui.horizontal_wrapped(|ui| {
        kind_ui(ui, &mut view.ruler);
        let unit = view.measures.unit.unwrap_or(session.unit);
        value_ui(ui, &view.ruler, unit);
        ui.add_enabled_ui(view.ruler.kind == RulerKind::Length, |ui| {
            unit_ui(ui, "Ruler unit", &mut view.measures.unit, session);
        });
        undo_ui(ui, &mut view.ruler);
    });
    let has_cameras = session
        .project
        .frames
        .iter()
        .any(|frame| frame.posed_camera().is_some());
    if has_cameras && view.ruler.kind == RulerKind::Length {
        ui.horizontal_wrapped(|ui| scale_ui(ui, session, view, actions));
    }
}

fn value_ui(ui: &mut Ui, ruler: &Ruler, unit: LengthUnit) {
    let size = egui::vec2(VALUE_WIDTH, ui.spacing().interact_size.y);
    let layout = egui::Layout::left_to_right(egui::Align::Center);
    ui.allocate_ui_with_layout(size, layout, |ui| {
        ui.set_min_width(VALUE_WIDTH);
        match ruler.value() {
            Some((value, dimension)) => {
                let text = egui::Label::new(unit.text(value, dimension)).extend();
                ui.add(text).on_hover_text(tip(ruler, unit));
            }
            None => {
                ui.weak(ruler.hint());
            }
        }
    });
}

/// Reason why lengths have no metric unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ScaleGap {
    /// No known length was given.
    Unset,
    /// The cameras have a scale, but the cloud is older.
    OldCloud,
}

fn scale_gap(session: &SessionView<'_>) -> Option<ScaleGap> {
    if session.may_be_metric() || session.points().is_none() {
        return None;
    }
    let is_set = session.project.coordinates().unit != LengthUnit::World;
    Some(if is_set {
        ScaleGap::OldCloud
    } else {
        ScaleGap::Unset
    })
}

/// Says next to a measure that the scale is unknown, with a button that starts the ruler.
pub(super) fn scale_unknown_ui(ui: &mut Ui, session: &SessionView<'_>, view: &mut ViewState) {
    let color = ui.visuals().warn_fg_color;
    match scale_gap(session) {
        None => {}
        Some(ScaleGap::OldCloud) => {
            ui.colored_label(color, "The cloud is older than the scale – fuse again");
        }
        Some(ScaleGap::Unset) => {
            ui.horizontal_wrapped(|ui| {
                ui.colored_label(color, "Scale unknown –");
                start_ui(ui, view);
            });
        }
    }
}

/// Says next to measures that their scale is unknown, or that nothing confirms it.
pub(crate) fn scale_note_ui(ui: &mut Ui, session: &SessionView<'_>, view: &mut ViewState) {
    scale_unknown_ui(ui, session, view);
    let has_points = session.root.is_some() && session.points().is_some();
    if has_points && session.project.is_unit_assumed() {
        ui.horizontal_wrapped(|ui| {
            let tip = "A model made from photos alone, as by COLMAP, has no unit; measure a known length then";
            ui.weak("Given cameras are taken as metres")
                .on_hover_text(tip);
            start_ui(ui, view);
        });
    }
}

fn start_ui(ui: &mut Ui, view: &mut ViewState) {
    let button = ui.button("Measure a known length");
    if button.on_hover_text(START).clicked() {
        view.start_ruler();
    }
}

const START: &str =
    "Start the ruler: click both ends of a length that you know, then set the scale";
/// Size of the mark below the scale bar, in screen points.
const MARK: egui::Vec2 = egui::vec2(210.0, 17.0);

/// Draws a button below the scale bar while its unit is unknown.
pub(super) fn scale_bar_mark_ui(
    ui: &mut Ui,
    rect: Rect,
    session: &SessionView<'_>,
    view: &mut ViewState,
) {
    let Some(gap) = scale_gap(session).filter(|_| view.prefs.scene.scale_bar) else {
        return;
    };
    let (text, tip) = match gap {
        ScaleGap::Unset => ("Scale unknown – measure a length", START),
        ScaleGap::OldCloud => (
            "Older than the scale – fuse again",
            "The cloud was made before the scale of the cameras was set",
        ),
    };
    let at = Rect::from_center_size(rect.center_bottom() - egui::vec2(0.0, 9.0), MARK);
    let builder = egui::UiBuilder::new()
        .max_rect(at)
        .layout(egui::Layout::centered_and_justified(
            egui::Direction::TopDown,
        ));
    let text = egui::RichText::new(text)
        .small()
        .color(ui.visuals().warn_fg_color);
    let button = egui::Button::new(text).small().frame(false);
    let mut ui = ui.new_child(builder);
    if ui.add(button).on_hover_text(tip).clicked() && gap == ScaleGap::Unset {
        view.start_ruler();
    }
}

/// Returns the unit of positions, for a tooltip.
pub(super) fn position_unit(session: &SessionView<'_>) -> &'static str {
    match session.unit {
        LengthUnit::World if session.inspected.is_some() => "In the unit of the file",
        LengthUnit::World => "In world units; the scale is unknown",
        _ => "In metres",
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
    let has_points = !ruler.points.is_empty();
    let by_key = has_points
        && !ui.ctx().text_edit_focused()
        && ui.input(|input| input.key_pressed(Key::Backspace));
    let none = (!has_points).then_some("No point is set yet");
    let tip = "Remove the last point (Backspace or right click)";
    let undo = add_explained(ui, egui::Button::new("Undo click"), tip, none);
    if undo.clicked() || by_key {
        ruler.undo_click();
    }
    let clear = egui::Button::new("Clear");
    if add_explained(ui, clear, "Remove all points", none).clicked() {
        ruler.points.clear();
    }
}

/// Returns why the scale cannot be set now.
pub(crate) fn scale_refusal(session: &SessionView<'_>, ruler: &Ruler) -> Option<&'static str> {
    let frames = &session.project.frames;
    let is_measured = |frame: &Frame| frame.has_sensor_depth() && frame.posed_camera().is_some();
    let is_known = session.project.coordinates().unit != LengthUnit::World;
    if is_known && frames.iter().any(is_measured) {
        Some("The depth sensor gives the scale")
    } else if scale_gap(session) == Some(ScaleGap::OldCloud) {
        Some("The cloud is older than the scale; fuse again first")
    } else if ruler.points.len() < 2 {
        Some("Click both ends of a length that you know first")
    } else if ruler.points.len() > 2 {
        Some("The scale is set by two points; remove the others")
    } else if ruler.length <= 0.0 {
        Some("Enter the true length first")
    } else if ruler.command().is_none() {
        Some("Both ends are the same point")
    } else {
        None
    }
}

/// Draws the row that sets the scale by the true length between two points.
fn scale_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    actions: &mut Vec<Action>,
) {
    let unit = view.ruler.length_unit;
    ui.label("True length");
    let length = DragValue::new(&mut view.ruler.length)
        .range(0.0..=1e9)
        .speed(0.1)
        .max_decimals(6);
    let tip = format!("True distance of the two points in {}", unit.sign());
    let size = egui::vec2(56.0, ui.spacing().interact_size.y);
    ui.name_inputs("True length", |ui| ui.add_sized(size, length))
        .on_hover_text(tip);
    let unit = &mut view.ruler.length_unit;
    let choice = ComboBox::from_id_salt("true length unit")
        .selected_text(unit.sign())
        .width(50.0)
        .show_ui(ui, |ui| {
            for metric in LengthUnit::METRIC {
                ui.selectable_value(unit, metric, metric.sign());
            }
        });
    choice
        .response
        .on_hover_text("Unit of the true length")
        .accessible_name("Unit of the true length");
    let action = Action::SetScale;
    let refusal = action.unavailable(session, view);
    if action_button(ui, &view.prefs.shortcuts, action, "Set scale", refusal).clicked() {
        actions.push(action);
    }
}

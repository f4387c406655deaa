use egui::{Button, ComboBox, DragValue, Ui};
use ostra_session::JobTask;

use super::measure_table::AngleChoice;
use super::scene_tools::Ruler;
use crate::SessionView;
use crate::session_view::labels_of;
use crate::tooltips::{add_explained, explained};
use ostra_cloud::measure::{GroundChoice, LengthUnit, TraitRow};
use ostra_masks::{LabelId, LabelTree};
use ostra_view::Axes;

/// Maximum number of parts listed in a tooltip.
const MOST_PIECES: usize = 12;

/// Draws the button that adds an angle, with the selected label as its first.
pub(super) fn add_angle_ui(ui: &mut Ui, chosen: Option<LabelId>, angles: &mut Vec<AngleChoice>) {
    let tip = "Measure the angle between two labels where they meet, such as a leaf and its stem";
    if ui.button("Add angle").on_hover_text(tip).clicked() {
        angles.push(AngleChoice([chosen, None]));
    }
}

/// Draws a line per angle: its two labels and the measured value.
pub(super) fn angles_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    tree: &LabelTree,
    angles: &mut Vec<AngleChoice>,
) {
    let mut removed = None;
    for (place, choice) in angles.iter_mut().enumerate() {
        let number = place + 1;
        ui.horizontal_wrapped(|ui| {
            ui.label("Angle between");
            label_ui(
                ui,
                tree,
                &format!("First label of angle {number}"),
                &mut choice.0[0],
            );
            ui.label("and");
            label_ui(
                ui,
                tree,
                &format!("Second label of angle {number}"),
                &mut choice.0[1],
            );
            value_ui(ui, session, choice.pair());
            let button = ui.small_button("×").on_hover_text("Remove this angle");
            if button
                .accessible_name(format!("Remove angle {number}"))
                .clicked()
            {
                removed = Some(place);
            }
        });
    }
    if let Some(place) = removed {
        angles.remove(place);
    }
}

fn label_ui(ui: &mut Ui, tree: &LabelTree, name: &str, chosen: &mut Option<LabelId>) {
    let text = chosen
        .and_then(|id| tree.get(id))
        .map_or("choose…", |label| label.name.as_str());
    let choice = ComboBox::from_id_salt(name)
        .selected_text(text)
        .width(110.0)
        .show_ui(ui, |ui| {
            for label in tree.iter() {
                ui.selectable_value(chosen, Some(label.id), &label.name);
            }
        });
    choice
        .response
        .on_hover_text("Label at one side of the angle")
        .accessible_name(name);
}

fn value_ui(ui: &mut Ui, session: &SessionView<'_>, pair: Option<[LabelId; 2]>) {
    let Some(pair) = pair else {
        ui.weak("Choose two labels");
        return;
    };
    match session.angles.and_then(|angles| angles.get(&pair)) {
        Some(Ok(rows)) => measured_ui(ui, session, rows),
        Some(Err(why)) => {
            ui.weak(why);
        }
        None if session.running(&JobTask::MeasureAngles).is_some() => {
            ui.spinner();
            ui.label("Measuring…");
        }
        None => {
            // The job starts with the next frame of the window.
            ui.ctx().request_repaint_after_secs(0.2);
            ui.weak("Not measured");
        }
    }
}

/// Shows the angle of the largest part, and the angles of all parts in the tooltip.
fn measured_ui(ui: &mut Ui, session: &SessionView<'_>, rows: &[TraitRow]) {
    let Some(first) = rows.first() else { return };
    let text = |row: &TraitRow| session.unit.text(row.value, row.dimension);
    let mut tip = format!(
        "{} = {}\nFrom {} points",
        first.name, first.definition, first.points
    );
    if rows.len() > 1 {
        let all: Vec<String> = rows.iter().take(MOST_PIECES).map(text).collect();
        let more = if rows.len() > MOST_PIECES {
            ", …"
        } else {
            ""
        };
        tip += &format!(
            "\nLargest of {} parts: {}{more}",
            rows.len(),
            all.join(", ")
        );
    }
    ui.label(text(first)).on_hover_text(tip);
}

/// Draws the choice of the ground, above which heights are measured.
pub(crate) fn ground_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    ruler: &Ruler,
    ground: &mut GroundChoice,
) {
    let tree = labels_of(session);
    let name = |id| tree.get(id).map_or("fitted", |label| label.name.as_str());
    let text = match *ground {
        GroundChoice::Fitted => "fitted",
        GroundChoice::Label(id) => name(id),
        GroundChoice::Plane { .. } => "given",
    };
    ui.label("Heights above");
    let choice = ComboBox::from_id_salt("ground")
        .selected_text(text)
        .width(110.0)
        .show_ui(ui, |ui| {
            ui.selectable_value(ground, GroundChoice::Fitted, "fitted");
            for label in tree.iter() {
                ui.selectable_value(ground, GroundChoice::Label(label.id), &label.name);
            }
            ui.separator();
            let through = ruler.plane(Axes::of_cameras(&session.project.frames).up);
            let is_through = through.is_some_and(|plane| plane == *ground);
            let button = Button::selectable(is_through, "through the ruler's points");
            let tip = "Take the plane through the three points of the ruler";
            let reason = through
                .is_none()
                .then_some("Set three points with the ruler first");
            if add_explained(ui, button, tip, reason).clicked() {
                *ground = through.unwrap_or(*ground);
            }
            let is_given = matches!(ground, GroundChoice::Plane { .. });
            if ui.selectable_label(is_given, "given as numbers").clicked() && !is_given {
                *ground = GroundChoice::Plane {
                    normal: [0.0, 0.0, 1.0],
                    offset: 0.0,
                };
            }
        });
    let tip = "Plane under the labelled points: fitted to unlabelled points, or to a label such as a table or soil";
    choice.response.on_hover_text(tip).accessible_name("Ground");
    if let GroundChoice::Plane { normal, offset } = ground {
        plane_ui(ui, normal, offset, session.unit);
    }
}

/// Draws the fields of a plane, all points x with normal · x = offset.
fn plane_ui(ui: &mut Ui, normal: &mut [f64; 3], offset: &mut f64, unit: LengthUnit) {
    let names = ["Normal x", "Normal y", "Normal z"];
    let before = *normal;
    for (number, name) in normal.iter_mut().zip(names) {
        let tip = "Up direction in world axes; any length";
        ui.add(DragValue::new(number).speed(0.01).max_decimals(4))
            .on_hover_text(tip)
            .accessible_name(name);
    }
    if *normal == [0.0; 3] {
        *normal = before;
    }
    let unit = match unit {
        LengthUnit::World => "in world units",
        _ => "in metres",
    };
    let tip = format!("normal · x of the points x on the plane, {unit}");
    ui.add(
        DragValue::new(offset)
            .speed(0.001)
            .max_decimals(5)
            .prefix("= "),
    )
    .on_hover_text(tip)
    .accessible_name("Offset");
}

/// Draws the choice of the length unit; `None` is the scene's own.
///
/// Metric units are offered if the scale is known.
pub(crate) fn unit_ui(
    ui: &mut Ui,
    name: &str,
    chosen: &mut Option<LengthUnit>,
    session: &SessionView<'_>,
) {
    let of_scene = session.unit;
    let mut unit = chosen.unwrap_or(of_scene);
    let metric = if session.may_be_metric() {
        &LengthUnit::METRIC[..]
    } else {
        &[]
    };
    let choice = ComboBox::from_id_salt("unit")
        .selected_text(unit.sign())
        .width(60.0)
        .show_ui(ui, |ui| {
            for other in metric.iter().copied().chain([LengthUnit::World]) {
                ui.selectable_value(&mut unit, other, other.sign());
            }
        });
    let tip = match session.may_be_metric() {
        true => "Unit of lengths; 'units' are the units of the scene",
        false => "The scale is not known: measure a known length with the ruler and set the scale",
    };
    let reason = (!choice.response.enabled()).then_some("An angle has no unit of length");
    explained(choice.response, tip, reason).accessible_name(name);
    *chosen = (unit != of_scene).then_some(unit);
}

use egui::{ComboBox, Ui};

use crate::Look;
use ostra_cloud::measure::TraitRow;
use ostra_masks::{LabelId, LabelTree};

/// Two labels, chosen one after the other, whose angle is told.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct AngleChoice([Option<LabelId>; 2]);

impl AngleChoice {
    /// Both labels, once they are chosen.
    pub(super) fn pair(&self) -> Option<[LabelId; 2]> {
        let [first, second] = self.0;
        Some([first?, second?])
    }
}

/// So many pieces are told in a tip.
const MOST_PIECES: usize = 12;

/// A button that begins another angle, with the chosen label as its first.
pub(super) fn add_angle_ui(ui: &mut Ui, chosen: Option<LabelId>, angles: &mut Vec<AngleChoice>) {
    let tip =
        "Tells the angle between two labels where they meet: a leaf and its stem, two branches";
    if ui.button("Add angle").on_hover_text(tip).clicked() {
        angles.push(AngleChoice([chosen, None]));
    }
}

/// A line for each angle: its labels, and the angle between them.
pub(super) fn angles_ui(
    ui: &mut Ui,
    look: &Look<'_>,
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
            value_ui(ui, look, choice.pair());
            let button = ui
                .small_button("×")
                .on_hover_text("Tells this angle no more");
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
        .on_hover_text("One of the two labels between which the angle is")
        .accessible_name(name);
}

fn value_ui(ui: &mut Ui, look: &Look<'_>, pair: Option<[LabelId; 2]>) {
    let Some(pair) = pair else {
        ui.weak("Choose two labels");
        return;
    };
    match look.angles.and_then(|angles| angles.get(&pair)) {
        Some(Ok(rows)) => told_ui(ui, look, rows),
        Some(Err(why)) => {
            ui.weak(why);
        }
        None if look.running("Measure angles").is_some() => {
            ui.spinner();
            ui.label("Measuring…");
        }
        None => {
            // The job begins with the next picture of the window.
            ui.ctx().request_repaint_after_secs(0.2);
            ui.weak("Not measured");
        }
    }
}

/// The angle of the largest piece; those of all in the tip.
fn told_ui(ui: &mut Ui, look: &Look<'_>, rows: &[TraitRow]) {
    let Some(first) = rows.first() else { return };
    let text = |row: &TraitRow| look.unit.text(row.value, row.dimension);
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
            "\nOf the largest of {} pieces: {}{more}",
            rows.len(),
            all.join(", ")
        );
    }
    ui.label(text(first)).on_hover_text(tip);
}

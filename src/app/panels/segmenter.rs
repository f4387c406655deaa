use egui::Ui;

use crate::app::look::{EngineKind, EngineLook};
use crate::app::tips::field;
use crate::app::{Look, ViewState};

/// Chooses what turns clicks into masks, and says what is installed.
pub(in crate::app) fn segmenter_ui(ui: &mut Ui, look: &Look<'_>, view: &mut ViewState) {
    egui::Grid::new("segmenter").num_columns(2).show(ui, |ui| {
        field(ui, "Segmenter", "Turns clicks and boxes into masks", |ui| {
            engine_choice_ui(ui, "segmenter", look.engines_of(EngineKind::Segmenter), &mut view.segmenter);
        });
    });
}

/// A list of engines: those not installed are shown, with how to get them, but cannot be chosen.
pub(super) fn engine_choice_ui<'a>(
    ui: &mut Ui,
    salt: &str,
    engines: impl Iterator<Item = &'a EngineLook>,
    chosen: &mut String,
) {
    let engines: Vec<_> = engines.collect();
    let text = match chosen.as_str() {
        "auto" => "Automatic",
        other => other,
    };
    egui::ComboBox::from_id_salt(salt).selected_text(text).width(150.0).show_ui(ui, |ui| {
        let auto = ui.selectable_label(chosen == "auto", "Automatic");
        if auto.on_hover_text("Takes the best that is installed").clicked() {
            *chosen = "auto".into();
        }
        for engine in engines {
            if engine_row_ui(ui, engine, chosen == &engine.name) {
                chosen.clone_from(&engine.name);
            }
        }
    });
}

fn engine_row_ui(ui: &mut Ui, engine: &EngineLook, selected: bool) -> bool {
    let text = if engine.installed { engine.name.clone() } else { format!("{} (not installed)", engine.name) };
    let row = ui.add_enabled(engine.installed, egui::Button::selectable(selected, text));
    row.on_hover_text(&engine.note).on_disabled_hover_text(&engine.note).clicked()
}

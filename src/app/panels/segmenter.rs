use egui::Ui;

use crate::tips::field;
use crate::{Look, ViewState};
use ostra_session::{Engine, EngineKind};

/// Chooses what turns clicks into masks, and says what is installed.
pub(crate) fn segmenter_ui(ui: &mut Ui, look: &Look<'_>, view: &mut ViewState) {
    egui::Grid::new("segmenter").num_columns(2).show(ui, |ui| {
        field(ui, "Segmenter", "Turns clicks and boxes into masks", |ui| {
            engine_choice_ui(
                ui,
                "segmenter",
                look.engines_of(EngineKind::Segmenter),
                &mut view.segmenter,
            );
        });
    });
}

/// A list of engines: those not installed are shown, with what they need, but cannot be chosen.
pub(super) fn engine_choice_ui<'a>(
    ui: &mut Ui,
    salt: &str,
    engines: impl Iterator<Item = &'a Engine>,
    chosen: &mut String,
) {
    let text = if chosen == "auto" {
        "Automatic"
    } else {
        chosen.as_str()
    }
    .to_owned();
    egui::ComboBox::from_id_salt(salt)
        .selected_text(text)
        .width(150.0)
        .show_ui(ui, |ui| {
            for engine in engines {
                if engine_row_ui(ui, engine, chosen == engine.name) {
                    engine.name.clone_into(chosen);
                }
            }
        });
}

fn engine_row_ui(ui: &mut Ui, engine: &Engine, selected: bool) -> bool {
    let text = match (engine.name, engine.installed) {
        ("auto", _) => "Automatic".into(),
        (name, true) => name.to_owned(),
        (name, false) => format!("{name} (not installed)"),
    };
    let tip = format!("Needs {}", engine.needs);
    let row = ui.add_enabled(engine.installed, egui::Button::selectable(selected, text));
    row.on_hover_text(&tip)
        .on_disabled_hover_text(tip)
        .clicked()
}

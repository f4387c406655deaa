use egui::Ui;

use super::labels::add_label;
use crate::canvas::id_at;
use crate::menu::is_possible;
use crate::tips::action_button;
use crate::{Action, Look, ViewState};
use ostra_masks::LabelId;
use ostra_session::{Command, Suggestion};

/// Things that no label explains: look at them, or make labels of them.
pub(crate) fn suggestions_ui(
    ui: &mut Ui,
    look: &Look<'_>,
    view: &mut ViewState,
    out: &mut Vec<Command>,
    wishes: &mut Vec<Action>,
) {
    let is_running = ["Suggest", "Propose"]
        .into_iter()
        .any(|title| look.running(title).is_some());
    ui.horizontal_wrapped(|ui| {
        for (action, text) in [
            (Action::Suggest, "Look for objects"),
            (Action::Propose, "Propose things here"),
        ] {
            let possible = !is_running && is_possible(action, look, view);
            if action_button(ui, &view.prefs.shortcuts, action, text, possible).clicked() {
                wishes.push(action);
            }
        }
        if is_running {
            ui.spinner();
        }
    });
    for (number, suggestion) in (1..)
        .zip(look.suggestions)
        .filter(|(_, one)| !is_explained(look, one))
    {
        ui.horizontal(|ui| {
            let show = ui
                .link(format!("{number}  {}", suggestion.text()))
                .on_hover_text("Goes to the frame, where a box with this number is around it");
            if show
                .accessible_name(format!("Suggestion {number}"))
                .clicked()
            {
                view.go_to(suggestion.frame);
            }
            let add = ui
                .small_button("Add")
                .on_hover_text("Makes a label of it on that frame; track it from there");
            if add
                .accessible_name(format!("Add suggestion {number}"))
                .clicked()
            {
                let id = look.project.labels.next_id();
                add_label(look, view, out);
                out.push(suggestion.prompt(id, &view.segmenter));
                view.go_to(suggestion.frame);
            }
        });
    }
}

/// Whether a label was given there meanwhile.
pub(crate) fn is_explained(look: &Look<'_>, suggestion: &Suggestion) -> bool {
    let mask = look.project.masks.get(&suggestion.frame);
    mask.is_some_and(|mask| id_at(&mask.runs, suggestion.at_px) != LabelId::NONE)
}

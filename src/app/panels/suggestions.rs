use egui::Ui;

use super::labels::add_label;
use crate::app::tips::action_button;
use crate::app::{Action, Look, ViewState};
use crate::session::Command;

/// Things that no label explains: look at them, or make labels of them.
pub(in crate::app) fn suggestions_ui(
    ui: &mut Ui,
    look: &Look<'_>,
    view: &mut ViewState,
    out: &mut Vec<Command>,
    wishes: &mut Vec<Action>,
) {
    let action = Action::Suggest;
    let possible = look.running("Suggest").is_none() && !look.project.masks.is_empty();
    ui.horizontal(|ui| {
        if action_button(ui, &view.prefs.shortcuts, action, "Look for objects", possible).clicked() {
            wishes.push(action);
        }
        if look.running("Suggest").is_some() {
            ui.spinner();
        }
    });
    for (number, suggestion) in (1..).zip(look.suggestions) {
        ui.horizontal(|ui| {
            let text = suggestion.text();
            let show = ui.link(&text).on_hover_text("Goes to the frame and shows it in the middle");
            if show.accessible_name(format!("Suggestion {number}")).clicked() {
                view.go_to(suggestion.frame);
                view.zoom.centre_px = suggestion.at_px;
            }
            let add = ui.small_button("Add").on_hover_text("Makes a label of it on that frame; track it from there");
            if add.accessible_name(format!("Add suggestion {number}")).clicked() {
                let id = look.project.labels.next_id();
                add_label(look, view, out);
                out.push(suggestion.prompt(id, &view.segmenter));
                view.go_to(suggestion.frame);
            }
        });
    }
}

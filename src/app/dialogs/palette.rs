use egui::{Button, Key, ScrollArea, TextEdit, Ui};

use crate::menu::{is_possible, text_now};
use crate::tips::modal;
use crate::{Action, Look, ViewState};

/// A list of all actions to type into; Enter does the first one.
pub(crate) fn palette_ui(ui: &Ui, look: &Look<'_>, view: &mut ViewState, wishes: &mut Vec<Action>) {
    let mut chosen = None;
    let response = modal(ui, "palette", 440.0, |ui| {
        let edit = TextEdit::singleline(&mut view.palette_text)
            .hint_text("Type what you want to do")
            .desired_width(f32::INFINITY);
        let edit = ui.add(edit).accessible_name("Find action");
        let entered = edit.lost_focus() && ui.input(|i| i.key_pressed(Key::Enter));
        if !entered {
            edit.request_focus();
        }
        let found = matching(&view.palette_text, look, view);
        ScrollArea::vertical().max_height(360.0).show(ui, |ui| {
            ui.with_layout(egui::Layout::top_down_justified(egui::Align::Min), |ui| {
                for &action in &found {
                    let keys = view.prefs.shortcuts.text(ui.ctx(), action);
                    let button = Button::new(text_now(action, look))
                        .shortcut_text(keys)
                        .frame_when_inactive(false);
                    if ui
                        .add_enabled(is_possible(action, look, view), button)
                        .on_hover_text(action.tip())
                        .clicked()
                    {
                        chosen = Some(action);
                    }
                }
            });
        });
        if entered {
            chosen = found
                .iter()
                .copied()
                .find(|&action| is_possible(action, look, view));
        }
    });
    if chosen.is_some() || response.should_close() {
        view.dialog = None;
        view.palette_text.clear();
    }
    wishes.extend(chosen);
}

/// Actions whose text holds every word typed; those that can be done first.
fn matching(typed: &str, look: &Look<'_>, view: &ViewState) -> Vec<Action> {
    let words: Vec<String> = typed.split_whitespace().map(str::to_lowercase).collect();
    let fits = |action: &Action| {
        let text = format!("{} {}", action.text(), action.tip()).to_lowercase();
        words.iter().all(|word| text.contains(word))
    };
    let mut found: Vec<_> = Action::all()
        .filter(fits)
        .filter(|action| *action != Action::Palette)
        .collect();
    let in_text = |action: &Action| {
        words
            .iter()
            .all(|word| action.text().to_lowercase().contains(word))
    };
    found.sort_by_key(|action| (!is_possible(*action, look, view), !in_text(action)));
    found
}

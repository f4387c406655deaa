use egui::{Button, Key, Modifiers, ScrollArea, TextEdit, Ui};

use crate::tooltips::{explained, modal};
use crate::{Action, SessionView, ViewState};

/// Preferred width of the palette in points.
const WIDTH: f32 = 640.0;

/// Draws a searchable list of all actions; arrow keys highlight one and Enter performs it.
pub(crate) fn palette_ui(
    ui: &Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    actions: &mut Vec<Action>,
) {
    let mut chosen = None;
    let screen = ui.ctx().content_rect();
    let width = (screen.width() - 80.0).min(WIDTH);
    let response = modal(ui, "palette", width, |ui| {
        let steps = arrow_steps(ui);
        let edit = TextEdit::singleline(&mut view.palette.text)
            .hint_text("Search actions")
            .desired_width(f32::INFINITY);
        let edit = ui.add(edit).accessible_name("Find action");
        if edit.changed() {
            view.palette.row = 0;
        }
        let found = matching(&view.palette.text, session, view);
        let last = found.len().saturating_sub(1);
        let row = view.palette.row.min(last).saturating_add_signed(steps);
        view.palette.row = row.min(last);
        let highlighted = found.get(view.palette.row).copied();
        if edit.lost_focus() && ui.input(|i| i.key_pressed(Key::Enter)) {
            chosen = highlighted.filter(|action| action.is_available(session, view));
        }
        if chosen.is_none() {
            edit.request_focus();
        }
        ui.add_space(4.0);
        let height = (screen.height() - 220.0).clamp(80.0, 360.0);
        ScrollArea::vertical().max_height(height).show(ui, |ui| {
            ui.with_layout(egui::Layout::top_down_justified(egui::Align::Min), |ui| {
                for &action in &found {
                    let is_highlighted = highlighted == Some(action);
                    let row = row_ui(ui, session, view, action, is_highlighted);
                    if is_highlighted && steps != 0 {
                        row.scroll_to_me(None);
                    }
                    if row.clicked() {
                        chosen = Some(action);
                    }
                }
            });
        });
        ui.separator();
        match highlighted {
            Some(action) => drop(ui.weak(action.tip())),
            None => drop(ui.weak("No action contains these words")),
        }
    });
    if chosen.is_some() || response.should_close() {
        view.dialog = None;
        view.palette = Default::default();
    }
    actions.extend(chosen);
}

/// Returns by how many rows the arrow keys move the highlight, and consumes them.
fn arrow_steps(ui: &Ui) -> isize {
    let presses = |key| ui.input_mut(|input| input.count_and_consume_key(Modifiers::NONE, key));
    presses(Key::ArrowDown) as isize - presses(Key::ArrowUp) as isize
}

/// Draws an action with its shortcut, or with the reason why it cannot be performed.
fn row_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &ViewState,
    action: Action,
    is_highlighted: bool,
) -> egui::Response {
    let unavailable = action.unavailable(session, view);
    let keys = view.prefs.shortcuts.text(ui.ctx(), action);
    let right = unavailable.map_or(keys, str::to_owned);
    let text = action.text_now(session);
    let button = Button::selectable(is_highlighted, text.as_str())
        .truncate()
        .right_text(egui::RichText::new(right).weak());
    let row = ui.add_enabled(unavailable.is_none(), button);
    explained(row, action.tip(), unavailable).accessible_name(text)
}

/// Returns actions that contain every typed word, available ones first.
fn matching(typed: &str, session: &SessionView<'_>, view: &ViewState) -> Vec<Action> {
    let words: Vec<String> = typed.split_whitespace().map(str::to_lowercase).collect();
    let has_all = |text: &str| {
        let text = text.to_lowercase();
        words.iter().all(|word| text.contains(word))
    };
    let mut found: Vec<_> = Action::all()
        .filter(|action| has_all(&format!("{} {}", action.text(), action.tip())))
        .filter(|action| *action != Action::Palette)
        .collect();
    found.sort_by_key(|action| {
        (
            !action.is_available(session, view),
            !has_all(&action.text()),
        )
    });
    found
}

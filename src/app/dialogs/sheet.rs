use egui::{Button, Context, Event, Grid, Key, RichText, ScrollArea, TextEdit, Ui};

use crate::menu::{is_possible, text_now};
use crate::shortcuts::pressed_keys;
use crate::tooltips::modal;
use crate::{Action, MenuName, SessionView, ViewState};

const POINTER: [(&str, &str); 12] = [
    ("Left click", "Include"),
    ("Right click", "Exclude"),
    ("Left drag", "Box"),
    ("Wheel", "Zoom at the pointer"),
    ("Middle drag, Space + drag", "Move the image"),
    ("Shift + wheel", "Size of the brush"),
    ("Ctrl + brush, right button", "Erase"),
    ("3-D: left drag", "Orbit"),
    ("3-D: right drag", "Pan"),
    ("3-D: wheel", "Zoom to the pointer"),
    ("3-D: double click", "Centre the view on this point"),
    ("3-D: click a camera", "Go to its frame"),
];

/// Draws the shortcut sheet, with a button to change each shortcut, and the pointer gestures.
pub(crate) fn sheet_ui(ui: &Ui, view: &mut ViewState) {
    listen(ui.ctx(), view);
    let response = modal(ui, "shortcuts", 720.0, |ui| {
        ui.horizontal(|ui| {
            ui.heading("Shortcuts");
            match view
                .sheet
                .robbed
                .filter(|action| view.prefs.shortcuts.keys(*action).is_none())
            {
                Some(action) => {
                    let text = format!("'{}' had this shortcut and has none now", action.text());
                    ui.colored_label(ui.visuals().warn_fg_color, text)
                }
                None => ui.weak("Click a shortcut to change it"),
            };
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                if ui
                    .button("Close")
                    .on_hover_text("Close the window (Esc)")
                    .clicked()
                {
                    view.dialog = None;
                }
                let changed = view.prefs.shortcuts.is_changed();
                let reset = ui
                    .add_enabled(changed, Button::new("Reset all"))
                    .on_hover_text("Restore the default shortcuts");
                if reset.clicked() {
                    view.prefs.shortcuts.reset();
                }
            });
        });
        ui.add_space(6.0);
        let height = (ui.ctx().content_rect().height() - 150.0).max(200.0);
        ScrollArea::vertical()
            .max_height(height)
            .min_scrolled_height(height)
            .show(ui, |ui| {
                ui.columns(2, |columns| {
                    for menu in [MenuName::File, MenuName::Edit] {
                        menu_ui(&mut columns[0], view, menu);
                    }
                    for menu in [
                        MenuName::Range,
                        MenuName::View,
                        MenuName::Go,
                        MenuName::Run,
                        MenuName::Help,
                    ] {
                        menu_ui(&mut columns[1], view, menu);
                    }
                    pointer_ui(&mut columns[0]);
                });
            });
    });
    if response.should_close() && !view.sheet.is_listening() {
        view.dialog = None;
    }
}

fn menu_ui(ui: &mut Ui, view: &mut ViewState, menu: MenuName) {
    ui.label(RichText::new(menu.text()).strong());
    Grid::new(menu.text())
        .num_columns(2)
        .spacing([8.0, 2.0])
        .min_col_width(90.0)
        .show(ui, |ui| {
            for action in Action::all().filter(|action| action.menu() == Some(menu)) {
                row_ui(ui, view, action);
            }
            if menu == MenuName::Edit {
                ui.label(RichText::new("1 – 9").monospace());
                ui.label("Select label");
                ui.end_row();
            }
        });
    ui.add_space(8.0);
}

fn row_ui(ui: &mut Ui, view: &mut ViewState, action: Action) {
    let listening = view.sheet.changing == Some(action);
    let keys = if listening {
        "press a key…".into()
    } else {
        view.prefs.shortcuts.text(ui.ctx(), action)
    };
    let text = RichText::new(if keys.is_empty() { "–" } else { &keys }).monospace();
    let button = ui
        .add(Button::selectable(listening, text))
        .on_hover_text("Click, then press the new shortcut; Esc cancels");
    if button
        .accessible_name(format!("Shortcut of {}: {keys}", action.text()))
        .clicked()
    {
        view.sheet.changing = if listening { None } else { Some(action) };
    }
    ui.label(action.text()).on_hover_text(action.tip());
    ui.end_row();
}

fn pointer_ui(ui: &mut Ui) {
    ui.label(RichText::new("Pointer").strong());
    Grid::new("pointer")
        .num_columns(2)
        .spacing([8.0, 2.0])
        .show(ui, |ui| {
            for (what, does) in POINTER {
                ui.label(RichText::new(what).weak());
                ui.label(does);
                ui.end_row();
            }
        });
}

/// Takes the next key press as the new shortcut of the action that waits for one.
fn listen(ctx: &Context, view: &mut ViewState) {
    let Some(action) = view.sheet.changing else {
        return;
    };
    let keys = ctx.input(|input| input.events.iter().find_map(pressed_keys));
    let Some(keys) = keys else { return };
    // The event is consumed so that it neither closes the sheet nor triggers its old action.
    ctx.input_mut(|input| {
        input
            .events
            .retain(|event| !matches!(event, Event::Key { .. } | Event::Text(_)));
    });
    view.sheet.changing = None;
    if keys.logical_key != Key::Escape {
        view.sheet.robbed = view.prefs.shortcuts.set(action, keys);
    }
}

/// Draws a searchable list of all actions; Enter performs the first possible one.
pub(crate) fn palette_ui(
    ui: &Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    actions: &mut Vec<Action>,
) {
    let mut chosen = None;
    let response = modal(ui, "palette", 440.0, |ui| {
        let edit = TextEdit::singleline(&mut view.palette_text)
            .hint_text("Search actions")
            .desired_width(f32::INFINITY);
        let edit = ui.add(edit).accessible_name("Find action");
        let entered = edit.lost_focus() && ui.input(|i| i.key_pressed(Key::Enter));
        if !entered {
            edit.request_focus();
        }
        let found = matching(&view.palette_text, session, view);
        ScrollArea::vertical().max_height(360.0).show(ui, |ui| {
            ui.with_layout(egui::Layout::top_down_justified(egui::Align::Min), |ui| {
                for &action in &found {
                    let keys = view.prefs.shortcuts.text(ui.ctx(), action);
                    let button = Button::new(text_now(action, session))
                        .shortcut_text(keys)
                        .frame_when_inactive(false);
                    if ui
                        .add_enabled(is_possible(action, session, view), button)
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
                .find(|&action| is_possible(action, session, view));
        }
    });
    if chosen.is_some() || response.should_close() {
        view.dialog = None;
        view.palette_text.clear();
    }
    actions.extend(chosen);
}

/// Returns actions that contain every typed word, possible ones first.
fn matching(typed: &str, session: &SessionView<'_>, view: &ViewState) -> Vec<Action> {
    let text_prompt: Vec<String> = typed.split_whitespace().map(str::to_lowercase).collect();
    let fits = |action: &Action| {
        let text = format!("{} {}", action.text(), action.tip()).to_lowercase();
        text_prompt.iter().all(|word| text.contains(word))
    };
    let mut found: Vec<_> = Action::all()
        .filter(fits)
        .filter(|action| *action != Action::Palette)
        .collect();
    let in_text = |action: &Action| {
        text_prompt
            .iter()
            .all(|word| action.text().to_lowercase().contains(word))
    };
    found.sort_by_key(|action| (!is_possible(*action, session, view), !in_text(action)));
    found
}

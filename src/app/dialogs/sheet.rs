use egui::{Button, Context, Event, Grid, Key, RichText, ScrollArea, TextEdit, Ui};

use crate::shortcuts::pressed_keys;
use crate::tooltips::add_explained;
use crate::{Action, MenuName, ViewState};

const POINTER: [(&str, &str); 14] = [
    ("Left click", "Include"),
    ("Ctrl + click, Ctrl + drag", "Label another object"),
    ("Right click", "Exclude"),
    ("Left drag", "Box"),
    ("Wheel", "Zoom at the pointer"),
    ("Middle drag, Space + drag", "Move the image"),
    ("Shift + wheel", "Size of the brush"),
    ("Alt + wheel", "Size of the last answer"),
    ("Ctrl + brush, right button", "Erase"),
    ("3-D: left drag", "Orbit"),
    ("3-D: right drag", "Pan"),
    ("3-D: wheel", "Zoom to the pointer"),
    ("3-D: double click", "Centre the view on this point"),
    ("3-D: click a camera", "Go to its frame"),
];

/// Menus in the left and the right column.
const COLUMNS: [&[MenuName]; 2] = [
    &[
        MenuName::File,
        MenuName::Edit,
        MenuName::Vote,
        MenuName::Points,
        MenuName::Tools,
        MenuName::Range,
    ],
    &[
        MenuName::View,
        MenuName::Layout,
        MenuName::Viewpoint,
        MenuName::Go,
        MenuName::Run,
        MenuName::Help,
    ],
];

/// Draws all shortcuts with a button to change each, and the pointer gestures.
pub(super) fn shortcuts_ui(ui: &mut Ui, view: &mut ViewState) {
    ui.horizontal(|ui| {
        let filter = TextEdit::singleline(&mut view.sheet.filter)
            .hint_text("Search shortcuts")
            .desired_width(180.0);
        ui.add(filter)
            .on_hover_text("List only actions with these words or keys")
            .accessible_name("Search shortcuts");
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
            let unchanged = !view.prefs.shortcuts.is_changed();
            let reason = unchanged.then_some("No shortcut was changed");
            let tip = "Restore the default shortcuts";
            if add_explained(ui, Button::new("Reset all"), tip, reason).clicked() {
                view.prefs.shortcuts.reset();
            }
        });
    });
    ui.add_space(6.0);
    let height = (ui.ctx().content_rect().height() - 200.0).max(160.0);
    ScrollArea::vertical()
        .max_height(height)
        .min_scrolled_height(height)
        .show(ui, |ui| {
            ui.columns(2, |columns| {
                for (column, menus) in columns.iter_mut().zip(COLUMNS) {
                    for &menu in menus {
                        menu_ui(column, view, menu);
                    }
                }
                if view.sheet.filter.trim().is_empty() {
                    pointer_ui(&mut columns[1]);
                }
            });
        });
}

/// Returns `true` if an action has all words of the filter in its name, description or keys.
fn is_listed(ui: &Ui, view: &ViewState, action: Action) -> bool {
    let keys = view.prefs.shortcuts.text(ui.ctx(), action);
    let text = format!("{} {} {keys}", action.text(), action.tip()).to_lowercase();
    let filter = view.sheet.filter.to_lowercase();
    filter.split_whitespace().all(|word| text.contains(word))
}

fn menu_ui(ui: &mut Ui, view: &mut ViewState, menu: MenuName) {
    let rows: Vec<Action> = Action::all()
        .filter(|action| action.menu() == Some(menu))
        .filter(|action| is_listed(ui, view, *action))
        .collect();
    if rows.is_empty() {
        return;
    }
    ui.label(RichText::new(menu.path()).strong());
    Grid::new(menu.text())
        .num_columns(2)
        .spacing([8.0, 2.0])
        .min_col_width(90.0)
        .show(ui, |ui| {
            for action in rows {
                row_ui(ui, view, action);
            }
            if menu == MenuName::Edit && view.sheet.filter.trim().is_empty() {
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
pub(super) fn listen(ctx: &Context, view: &mut ViewState) {
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

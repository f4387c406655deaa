use egui::{Button, Context, Event, Grid, Key, RichText, ScrollArea, Ui};

use crate::shortcuts::pressed_keys;
use crate::tips::modal;
use crate::{Action, MenuName, ViewState};

/// The shortcut sheet: which action waits for new keys.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SheetState {
    changing: Option<Action>,
    /// The action that lost its keys to the one changed last.
    robbed: Option<Action>,
}

impl SheetState {
    /// Whether the next key press is a new shortcut and does nothing else.
    #[must_use]
    pub fn is_listening(&self) -> bool {
        self.changing.is_some()
    }
}

const POINTER: [(&str, &str); 12] = [
    ("Left click", "Include"),
    ("Right click", "Exclude"),
    ("Left drag", "Box"),
    ("Wheel", "Zoom at the pointer"),
    ("Middle drag, Space + drag", "Move the picture"),
    ("Shift + wheel", "Size of the brush"),
    ("Ctrl + brush, right button", "Erase"),
    ("3-D: left drag", "Orbit"),
    ("3-D: right drag", "Pan"),
    ("3-D: wheel", "Zoom to the pointer"),
    ("3-D: double click", "Turn about this point"),
    ("3-D: click a camera", "Go to its frame"),
];

/// All shortcuts, each with a button to change it, and what the pointer does.
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
                    let text = format!("'{}' had these keys and has none now", action.text());
                    ui.colored_label(ui.visuals().warn_fg_color, text)
                }
                None => ui.weak("Click a shortcut to change it"),
            };
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                if ui
                    .button("Close")
                    .on_hover_text("Closes the sheet (Esc)")
                    .clicked()
                {
                    view.dialog = None;
                }
                let changed = view.prefs.shortcuts.is_changed();
                let reset = ui
                    .add_enabled(changed, Button::new("Reset all"))
                    .on_hover_text("All shortcuts as at first");
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
                ui.label("Choose label");
                ui.end_row();
            }
        });
    ui.add_space(8.0);
}

fn row_ui(ui: &mut Ui, view: &mut ViewState, action: Action) {
    let listening = view.sheet.changing == Some(action);
    let keys = if listening {
        "press keys…".into()
    } else {
        view.prefs.shortcuts.text(ui.ctx(), action)
    };
    let text = RichText::new(if keys.is_empty() { "–" } else { &keys }).monospace();
    let button = ui
        .add(Button::selectable(listening, text))
        .on_hover_text("Click, then press the new keys; Esc leaves it");
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
    // Consumed, so that it neither closes the sheet nor does what it did before.
    ctx.input_mut(|input| {
        input
            .events
            .retain(|event| !matches!(event, Event::Key { .. } | Event::Text(_)))
    });
    view.sheet.changing = None;
    if keys.logical_key != Key::Escape {
        view.sheet.robbed = view.prefs.shortcuts.set(action, keys);
    }
}

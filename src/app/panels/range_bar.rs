//! Actions on the selected label over the selected range of frames.

use egui::Ui;

use crate::menu_entry::menu_entry_ui;
use crate::tooltips::action_button;
use crate::{Action, SessionView, ViewState};

/// Actions on the selected label over the range.
const BUTTONS: [(Action, &str); 10] = [
    (Action::DeleteRange, "Delete"),
    (Action::RestoreRange, "Restore"),
    (Action::AppearsHere, "Appears here"),
    (Action::GoneFromHere, "Disappears here"),
    (Action::LockRange, "Lock"),
    (Action::HideRange, "Hide"),
    (Action::MergeRange, "Merge…"),
    (Action::InterpolateRange, "Interpolate"),
    (Action::CopyMask, "Copy"),
    (Action::PasteMask, "Paste"),
];

/// Number of actions that have a button in the bar; the others are in its menu.
const IN_BAR: usize = 2;

/// Draws the selected range with its actions, in the place of the hint in the status line.
pub(super) fn range_bar_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &ViewState,
    actions: &mut Vec<Action>,
) {
    let Some((from, to)) = view.range else { return };
    let name = view
        .label
        .and_then(|id| session.project.labels.get(id))
        .map_or("no label", |label| label.name.as_str());
    ui.label(format!("{name}, frames {from}–{to}"))
        .on_hover_text("Frames changed by the buttons; drag over frames of the timeline, or set the ends with the Range menu");
    let drop = Action::DropRange;
    let button = action_button(ui, &view.prefs.shortcuts, drop, "×", None);
    if button.accessible_name(drop.text()).clicked() {
        actions.push(drop);
    }
    for (action, text) in &BUTTONS[..IN_BAR] {
        let reason = action.unavailable(session, view);
        let button = action_button(ui, &view.prefs.shortcuts, *action, text, reason);
        if button.accessible_name(action.text()).clicked() {
            actions.push(*action);
        }
    }
    ui.menu_button("…", |ui| range_menu_ui(ui, session, view, actions))
        .response
        .on_hover_text("More changes of the label in the range")
        .accessible_name("More range actions");
}

/// Draws the actions on the selected label over the range as lines of a menu.
pub(super) fn range_menu_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &ViewState,
    actions: &mut Vec<Action>,
) {
    for (action, _) in BUTTONS {
        if menu_entry_ui(ui, action, session, view) {
            actions.push(action);
            ui.close();
        }
    }
}

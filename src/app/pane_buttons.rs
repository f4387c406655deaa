//! Buttons at the right end of a pane's tool row.

use egui::Ui;

use super::icons::{Icon, IconButton};
use super::{Action, Panes, ViewState};

/// Draws the buttons at the right end of a pane's tool row; returns `true` if it is dragged away.
pub(super) fn pane_buttons_ui(
    ui: &mut Ui,
    view: &ViewState,
    alone: Action,
    actions: &mut Vec<Action>,
) -> bool {
    let is_alone = view.prefs.panes != Panes::Both;
    let action = if is_alone { Action::ShowBoth } else { alone };
    let tip = view.prefs.shortcuts.tip(ui.ctx(), action);
    let maximise = IconButton {
        icon: if is_alone {
            Icon::Restore
        } else {
            Icon::Maximise
        },
        name: &action.text(),
        tip: &tip,
        selected: None,
        unavailable: None,
    };
    if maximise.show(ui, false).clicked() {
        actions.push(action);
    }
    let grip = IconButton {
        icon: Icon::Grip,
        name: if alone == Action::ShowImage {
            "Move image pane"
        } else {
            "Move 3-D pane"
        },
        tip: "Drag to another place in the window",
        selected: None,
        unavailable: is_alone.then_some("There is only this pane"),
    };
    grip.show(ui, false).drag_started()
}

use egui::{MenuBar, Ui};

use super::action::Requests;
use super::icons::{Icon, paint_icon};
use super::menu_entry::{indented, menu_entry_ui};
use super::menu_name::MenuName;
use super::tooltips::{action_button, explained};
use super::{Action, SessionView, ViewState};
use ostra_session::Command;

/// Number of projects in the menu of recent ones.
const RECENT: usize = 10;

/// Draws the menu bar from the list of actions, with undo and redo at its end.
pub(super) fn menu_bar_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    requests: &mut Requests,
) {
    MenuBar::new().ui(ui, |ui| {
        for menu in MenuName::BAR {
            let button = ui.menu_button(menu.text(), |ui| {
                menu_ui(ui, menu, session, view, requests);
            });
            if std::mem::take(&mut view.focuses_menu) {
                button.response.request_focus();
            }
        }
        ui.separator();
        undo_redo_ui(ui, session, view, &mut requests.actions);
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            if theme_button_ui(ui, view).clicked() {
                requests.actions.push(Action::ToggleTheme);
            }
            let title = title(session);
            if !title.is_empty() {
                ui.weak(title);
            }
        });
    });
}

/// Returns the name of the open project or point cloud.
pub(super) fn title(session: &SessionView<'_>) -> String {
    let open = session
        .root
        .or(session.inspected)
        .and_then(|path| path.file_name());
    open.map(|name| name.to_string_lossy().into_owned())
        .unwrap_or_default()
}

/// Draws the entries of a menu and its submenus.
fn menu_ui(
    ui: &mut Ui,
    menu: MenuName,
    session: &SessionView<'_>,
    view: &ViewState,
    requests: &mut Requests,
) {
    ui.set_min_width(220.0);
    let mut drawn = None;
    for action in Action::all().filter(|action| action.menu().is_some()) {
        let Some(of) = action.menu() else { continue };
        let submenu = (of.parent() == Some(menu)).then_some(of);
        if of != menu && (submenu.is_none() || submenu == drawn) {
            continue;
        }
        if action.starts_group() {
            ui.separator();
        }
        if let Some(submenu) = submenu {
            drawn = Some(submenu);
            ui.menu_button(indented(submenu.text()), |ui| {
                submenu_ui(ui, submenu, session, view, &mut requests.actions);
            })
            .response
            .accessible_name(submenu.text());
        } else if menu_entry_ui(ui, action, session, view) {
            requests.actions.push(action);
        }
        if action == Action::Open {
            recent_ui(ui, session, &mut requests.commands);
        }
    }
}

fn submenu_ui(
    ui: &mut Ui,
    menu: MenuName,
    session: &SessionView<'_>,
    view: &ViewState,
    actions: &mut Vec<Action>,
) {
    ui.set_min_width(220.0);
    let mut is_first = true;
    for action in Action::all().filter(|action| action.menu() == Some(menu)) {
        if action.starts_group() && !std::mem::take(&mut is_first) {
            ui.separator();
        }
        is_first = false;
        if menu_entry_ui(ui, action, session, view) {
            actions.push(action);
        }
    }
}

fn recent_ui(ui: &mut Ui, session: &SessionView<'_>, out: &mut Vec<Command>) {
    let none = session.recent.is_empty();
    ui.add_enabled_ui(!none, |ui| {
        let menu = ui.menu_button(indented("Open recent"), |ui| {
            for path in session.recent.iter().take(RECENT) {
                if ui
                    .button(path.display().to_string())
                    .on_hover_text("Open this project")
                    .clicked()
                {
                    out.push(Command::Open(path.clone()));
                }
            }
        });
        let reason = none.then_some("No project was opened yet");
        explained(menu.response, "Open a project that was open before", reason)
            .accessible_name("Open recent");
    });
}

/// Draws the theme button.
fn theme_button_ui(ui: &mut Ui, view: &ViewState) -> egui::Response {
    let tip = view.prefs.shortcuts.tip(ui.ctx(), Action::ToggleTheme);
    let (rect, response) = ui.allocate_exact_size(egui::vec2(22.0, 20.0), egui::Sense::click());
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, "Dark theme"));
    let color = ui.style().interact(&response).text_color();
    paint_icon(ui.painter(), rect.center(), Icon::Contrast, color);
    response.on_hover_text(tip)
}

fn undo_redo_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &ViewState,
    actions: &mut Vec<Action>,
) {
    for (action, text) in [(Action::Undo, "Undo"), (Action::Redo, "Redo")] {
        let response = action_button(
            ui,
            &view.prefs.shortcuts,
            action,
            text,
            action.unavailable(session, view),
        );
        if response
            .on_hover_text(action.text_now(session))
            .accessible_name(action.text())
            .clicked()
        {
            actions.push(action);
        }
    }
}

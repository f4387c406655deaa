use egui::{Button, RichText, Ui};

use crate::action::Requests;
use crate::{Action, SessionView, ViewState};
use ostra_session::Command;

const STEPS: [(&str, &str); 4] = [
    ("Open", "photos, a video or an RGB-D recording"),
    ("Click", "on the objects you want, on any frame"),
    (
        "Track",
        "the masks through all frames; correct where needed",
    ),
    (
        "Fuse",
        "into a labelled point cloud, then measure and export",
    ),
];

/// Draws the welcome page with the first steps and recently opened projects.
pub(crate) fn welcome_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &ViewState,
    requests: &mut Requests,
) {
    let height = 330.0 + 24.0 * session.recent.len().min(8) as f32;
    ui.vertical_centered(|ui| {
        ui.add_space(((ui.available_height() - height) * 0.4).max(24.0));
        ui.set_max_width(430.0);
        ui.label(RichText::new("OSTRA").size(30.0).strong());
        ui.label(
            RichText::new("Turn photos and videos into labelled 3-D models")
                .weak()
                .size(15.0),
        );
        ui.add_space(22.0);
        ui.with_layout(egui::Layout::top_down(egui::Align::Min), steps_ui);
        ui.add_space(22.0);
        buttons_ui(ui, view, &mut requests.actions);
        ui.add_space(22.0);
        ui.with_layout(egui::Layout::top_down(egui::Align::Min), |ui| {
            recent_ui(ui, session, &mut requests.commands);
        });
    });
}

fn steps_ui(ui: &mut Ui) {
    for (number, (verb, rest)) in STEPS.iter().enumerate() {
        ui.horizontal(|ui| {
            ui.label(RichText::new(format!("{}", number + 1)).weak().size(15.0));
            ui.label(RichText::new(*verb).strong().size(15.0));
            ui.label(RichText::new(*rest).size(15.0));
        });
    }
}

fn buttons_ui(ui: &mut Ui, view: &ViewState, actions: &mut Vec<Action>) {
    let rows = [
        (Action::NewProject, "New project…"),
        (Action::Open, "Open project…"),
        (Action::Inspect, "View a point cloud…"),
    ];
    for (index, (action, text)) in rows.into_iter().enumerate() {
        let mut button =
            Button::new(RichText::new(text).size(15.0)).min_size(egui::vec2(300.0, 34.0));
        if index == 0 {
            button = button.fill(ui.visuals().selection.bg_fill);
        }
        if ui
            .add(button)
            .on_hover_text(view.prefs.shortcuts.tip(ui.ctx(), action))
            .clicked()
        {
            actions.push(action);
        }
        ui.add_space(2.0);
    }
}

fn recent_ui(ui: &mut Ui, session: &SessionView<'_>, out: &mut Vec<Command>) {
    if session.recent.is_empty() {
        return;
    }
    ui.strong("Recent projects");
    for path in session.recent.iter().take(8) {
        let name = path.file_name().map_or_else(
            || path.display().to_string(),
            |name| name.to_string_lossy().into_owned(),
        );
        ui.horizontal(|ui| {
            if ui
                .link(name)
                .on_hover_text(path.display().to_string())
                .clicked()
            {
                out.push(Command::Open(path.clone()));
            }
            let parent = path
                .parent()
                .map(|parent| parent.display().to_string())
                .unwrap_or_default();
            ui.add(egui::Label::new(RichText::new(parent).weak()).truncate());
        });
    }
}

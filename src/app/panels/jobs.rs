use egui::{ProgressBar, Ui};

use crate::tips::action_button;
use crate::{Action, Look, ViewState};
use ostra_session::JobView;

/// What is running, how far it is, and the button that stops it.
pub(crate) fn jobs_ui(ui: &mut Ui, look: &Look<'_>, view: &ViewState, wishes: &mut Vec<Action>) {
    for job in look.slow_jobs() {
        let detail = match (job.report.total, job.report.stage.as_str()) {
            (0, stage) => stage.to_owned(),
            (total, stage) => format!("{stage} {} of {total}", job.report.done),
        };
        ui.horizontal(|ui| {
            ui.strong(&job.title);
            ui.weak(detail.trim());
        });
        let report = &job.report;
        let share = report.done as f32 / report.total.max(1) as f32;
        let bar = ProgressBar::new(share)
            .desired_height(6.0)
            .animate(report.total == 0);
        ui.add(bar)
            .accessible_name(format!("Progress of {}", job.title));
    }
    if action_button(ui, &view.prefs.shortcuts, Action::Stop, "Stop all", true).clicked() {
        wishes.push(Action::Stop);
    }
}

/// The button that starts long work; while that work runs it stops it.
pub(super) fn run_button_ui(
    ui: &mut Ui,
    look: &Look<'_>,
    view: &ViewState,
    (action, title): (Action, &str),
    enabled: bool,
    wishes: &mut Vec<Action>,
) {
    let (action, text) = if look.running(title).is_some() {
        (Action::Stop, "Stop")
    } else {
        (action, title)
    };
    let strong = egui::RichText::new(text).strong();
    let button = egui::Button::new(strong).min_size(egui::vec2(92.0, 24.0));
    let tip = view.prefs.shortcuts.tip(ui.ctx(), action);
    let response = ui
        .add_enabled(enabled, button)
        .on_hover_text(&tip)
        .on_disabled_hover_text(tip);
    if response.clicked() {
        wishes.push(action);
    }
}

/// How far a job is, in words.
pub(crate) fn progress_text(job: &JobView) -> String {
    let report = &job.report;
    match (report.done * 100).checked_div(report.total) {
        Some(share) => format!("{} {share} %", report.stage),
        None => format!("{}…", report.stage),
    }
}

use egui::{ProgressBar, Ui};

use crate::app::tips::action_button;
use crate::app::{Action, Look, ViewState};

/// What is running, how far it is, and the button that stops it.
pub(in crate::app) fn jobs_ui(ui: &mut Ui, look: &Look<'_>, view: &ViewState, wishes: &mut Vec<Action>) {
    for job in look.jobs {
        let detail = match (job.total, job.stage.as_str()) {
            (0, stage) => stage.to_owned(),
            (total, stage) => format!("{stage} {} of {total}", job.done),
        };
        ui.horizontal(|ui| {
            ui.strong(&job.title);
            ui.weak(detail.trim());
        });
        let share = if job.total == 0 { 0.0 } else { job.done as f32 / job.total as f32 };
        let bar = ProgressBar::new(share).desired_height(6.0).animate(job.total == 0);
        ui.add(bar).accessible_name(format!("Progress of {}", job.title));
    }
    if !look.jobs.is_empty() && action_button(ui, &view.prefs.shortcuts, Action::Cancel, "Stop", true).clicked() {
        wishes.push(Action::Cancel);
    }
}

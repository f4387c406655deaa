use egui::{ProgressBar, RichText, Ui};
use ostra_session::JobTask;

use super::range_bar::range_bar_ui;
use crate::canvas::id_at;
use crate::tooltips::{action_button, grouped, primary_button};
use crate::{Action, SessionView, ViewState};
use ostra_masks::LabelId;
use ostra_session::JobView;

/// Draws the status line: shown frame, pixel under the pointer and running jobs.
pub(crate) fn status_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &ViewState,
    actions: &mut Vec<Action>,
) {
    ui.horizontal(|ui| {
        if let Some(frame) = session.project.frames.get(view.frame) {
            let count = session.project.frames.len();
            ui.label(format!(
                "Frame {} ({} of {count})",
                view.frame,
                view.frame + 1
            ))
            .on_hover_text("Frames are numbered from 0, as in files and on the command line");
            ui.weak(&frame.name);
            ui.separator();
            if view.range.is_some() {
                range_bar_ui(ui, session, view, actions);
            } else {
                pointer_ui(ui, session, view);
            }
        }
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            work_ui(ui, session);
            if let Some(cloud) = session.cloud {
                ui.weak(format!("{} points", grouped(cloud.len())));
            }
            if let Some(job) = session.slow_jobs().last() {
                let button = action_button(ui, &view.prefs.shortcuts, Action::Stop, "Stop", true);
                if button.accessible_name("Stop running job").clicked() {
                    actions.push(Action::Stop);
                }
                ui.weak(format!("{}: {}", job.title, progress_text(job)));
                ui.spinner();
            } else if !view.note.is_empty() {
                ui.add(egui::Label::new(RichText::new(&view.note)).truncate());
            }
        });
    });
}

/// Shows the number of manual interactions and the estimated accuracy of the masks.
fn work_ui(ui: &mut Ui, session: &SessionView<'_>) {
    let Some(estimate) = session.estimate else {
        return;
    };
    let (count, percent) = (session.interactions, estimate.accuracy * 100.0);
    let noun = if count == 1 {
        "interaction"
    } else {
        "interactions"
    };
    let tip = format!(
        "Clicks, boxes, strokes and corrections since the project was opened, including undone ones. The accuracy is \
         the mean of the tracker's confidence over labels on {} frames with masks; a keyframe counts as right",
        estimate.frames
    );
    ui.label(format!("{count} {noun}, est. accuracy {percent:.0} %"))
        .on_hover_text(tip);
    ui.separator();
}

fn pointer_ui(ui: &mut Ui, session: &SessionView<'_>, view: &ViewState) {
    let Some(at) = view.pointer_px else {
        ui.weak("Left click to include, right click to exclude, drag for a box");
        return;
    };
    ui.label(
        RichText::new(format!("x {:>5.0}  y {:>5.0}", at.x.floor(), at.y.floor())).monospace(),
    );
    let id = session
        .project
        .masks
        .get(&view.frame)
        .map_or(LabelId::NONE, |mask| id_at(&mask.runs, at));
    if let Some(label) = session.project.labels.get(id) {
        let path: Vec<_> = session
            .project
            .labels
            .path(id)
            .iter()
            .filter_map(|id| session.project.labels.get(*id))
            .collect();
        let [r, g, b] = label.color;
        let (rect, _) = ui.allocate_exact_size(egui::vec2(10.0, 10.0), egui::Sense::hover());
        ui.painter()
            .rect_filled(rect, 2.0, egui::Color32::from_rgb(r, g, b));
        ui.label(
            path.iter()
                .map(|label| label.name.as_str())
                .collect::<Vec<_>>()
                .join(" › "),
        );
    } else {
        ui.weak("no label");
    }
}

/// Draws the running jobs with their progress and stop button.
pub(crate) fn jobs_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &ViewState,
    actions: &mut Vec<Action>,
) {
    for job in session.slow_jobs() {
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
        actions.push(Action::Stop);
    }
}

/// Button that starts a task.
pub(super) struct RunButton<'a> {
    pub action: Action,
    pub task: &'a JobTask,
    pub is_enabled: bool,
}

/// Draws the button that starts a task, or stops it while it runs.
pub(super) fn run_button_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &ViewState,
    button: &RunButton<'_>,
    actions: &mut Vec<Action>,
) {
    let (action, text) = if session.running(button.task).is_some() {
        (Action::Stop, "Stop")
    } else {
        (button.action, button.task.title())
    };
    let enabled = button.is_enabled;
    let tip = view.prefs.shortcuts.tip(ui.ctx(), action);
    if primary_button(ui, text, &tip, enabled).clicked() {
        actions.push(action);
    }
}

/// Returns the progress of a job as text.
pub(crate) fn progress_text(job: &JobView) -> String {
    let report = &job.report;
    match (report.done * 100).checked_div(report.total) {
        Some(share) => format!("{} {share} %", report.stage),
        None => format!("{}…", report.stage),
    }
}

use egui::{Align, Button, Layout, ProgressBar, RichText, Ui, Vec2};
use ostra_core::job::{StepState, time_left_text};
use ostra_session::{Command, JobTask};

use super::counts::counts_ui;
use super::range_bar::range_bar_ui;
use crate::canvas::{KeyPointer, id_at};
use crate::tooltips::{action_button, grouped, primary_button};
use crate::{Action, SessionView, ViewState};
use ostra_masks::LabelId;
use ostra_session::JobView;

/// Draws the status line: shown frame, pixel under the pointer and running jobs.
///
/// What is at the right has its space first; the help for the pointer gets what is left.
pub(crate) fn status_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &ViewState,
    actions: &mut Vec<Action>,
) {
    let from_right = Layout::right_to_left(Align::Center);
    let size = Vec2::new(ui.available_width(), ui.spacing().interact_size.y);
    ui.allocate_ui_with_layout(size, from_right, |ui| {
        counts_ui(ui, session, view, actions);
        if let Some(cloud) = session.cloud {
            ui.weak(format!("{} points", grouped(cloud.len())));
        }
        let job = session.slow_jobs().last();
        if let Some(job) = job {
            let button = action_button(ui, &view.prefs.shortcuts, Action::Stop, "Stop", None);
            if button.accessible_name("Stop running job").clicked() {
                actions.push(Action::Stop);
            }
            ui.weak(format!("{}: {}", job.title, progress_text(job)));
            ui.spinner();
        }
        ui.with_layout(Layout::left_to_right(Align::Center), |ui| {
            if let Some(frame) = session.project.frames.get(view.frame) {
                frame_ui(ui, session, view, &frame.name, actions);
            }
            ui.with_layout(from_right, |ui| {
                if job.is_none() && !view.note.is_empty() {
                    note_ui(ui, &view.note);
                }
                if view.range.is_none() && session.has_frames() {
                    ui.with_layout(Layout::left_to_right(Align::Center), |ui| {
                        let help = match view.key_pointer.at_px() {
                            Some(_) => KeyPointer::HELP,
                            None => view.tool.help(),
                        };
                        ui.add(egui::Label::new(RichText::new(help).weak()).truncate());
                    });
                }
            });
        });
    });
}

/// Draws the last event in at most half of the space, so that the help for the pointer stays.
fn note_ui(ui: &mut Ui, note: &str) {
    let size = Vec2::new(ui.available_width() / 2.0, ui.available_height());
    ui.allocate_ui_with_layout(size, Layout::right_to_left(Align::Center), |ui| {
        ui.add(egui::Label::new(note).truncate());
    });
}

/// Draws the shown frame, and the pixel under the pointer or the selected range.
fn frame_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &ViewState,
    name: &str,
    actions: &mut Vec<Action>,
) {
    let count = session.project.frames.len();
    let text = format!("Frame {} ({} of {count})", view.frame, view.frame + 1);
    let number = ui.add(Button::new(text).frame_when_inactive(false).small());
    let keys = view.prefs.shortcuts.tip(ui.ctx(), Action::GoToFrame);
    let number = number.on_hover_text(format!(
        "Frames are numbered from 0, as in files and on the command line.\n{keys}"
    ));
    if number.clicked() {
        actions.push(Action::GoToFrame);
    }
    ui.weak(name);
    ui.separator();
    if view.range.is_some() {
        range_bar_ui(ui, session, view, actions);
    } else {
        pointer_ui(ui, session, view);
    }
}

fn pointer_ui(ui: &mut Ui, session: &SessionView<'_>, view: &ViewState) {
    let Some(at) = view.pointer_px else {
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
        ui.strong(&job.title);
        let fraction = job.overview.fraction;
        let bar = ProgressBar::new(fraction.unwrap_or(0.0) as f32)
            .desired_height(6.0)
            .animate(fraction.is_none());
        ui.add(bar)
            .accessible_name(format!("Progress of {}", job.title));
        ui.label(step_text(job));
        steps_ui(ui, job);
        if job.task.as_ref().is_some_and(allows_labelling) {
            ui.weak("You can go on labelling meanwhile");
        }
    }
    if action_button(ui, &view.prefs.shortcuts, Action::Stop, "Stop all", None).clicked() {
        actions.push(Action::Stop);
    }
}

/// Button that starts a task.
pub(super) struct RunButton<'a> {
    pub action: Action,
    pub task: &'a JobTask,
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
    let unavailable = action.unavailable(session, view);
    let tip = view.prefs.shortcuts.tip(ui.ctx(), action);
    if primary_button(ui, text, &tip, unavailable).clicked() {
        actions.push(action);
    }
}

/// Returns `true` if the result of a task does not depend on the labels that are edited meanwhile.
fn allows_labelling(task: &JobTask) -> bool {
    matches!(task, JobTask::Reconstruct)
}

/// Lists the steps of a job: those done with a tick, the running one in bold, those to come.
fn steps_ui(ui: &mut Ui, job: &JobView) {
    let steps = &job.overview.steps;
    if steps.len() < 2 {
        return;
    }
    for step in steps {
        let state = match step.state {
            StepState::Done => "done",
            StepState::Running => "running",
            StepState::ToCome => "to come",
        };
        let text = RichText::new(&step.title);
        let text = match step.state {
            StepState::Running => text.strong(),
            StepState::Done | StepState::ToCome => text.weak(),
        };
        ui.horizontal(|ui| {
            step_mark(ui, step.state);
            ui.label(text)
                .accessible_name(format!("{}: {state}", step.title));
        });
    }
}

/// Paints a tick for a step that is done, an arrow for the running one and a dot for later ones.
fn step_mark(ui: &mut Ui, state: StepState) {
    let (rect, _) = ui.allocate_exact_size(egui::Vec2::splat(12.0), egui::Sense::hover());
    let at = |x: f32, y: f32| rect.center() + egui::Vec2::new(x, y);
    let color = match state {
        StepState::Running => ui.visuals().strong_text_color(),
        StepState::Done | StepState::ToCome => ui.visuals().weak_text_color(),
    };
    let shape = match state {
        StepState::Done => {
            let tick = vec![at(-3.5, 0.2), at(-1.0, 3.0), at(3.8, -2.8)];
            egui::Shape::line(tick, egui::Stroke::new(1.6, color))
        }
        StepState::Running => {
            let arrow = vec![at(-3.0, -4.0), at(4.0, 0.0), at(-3.0, 4.0)];
            egui::Shape::convex_polygon(arrow, color, egui::Stroke::NONE)
        }
        StepState::ToCome => egui::Shape::circle_filled(at(0.0, 0.0), 1.5, color),
    };
    ui.painter().add(shape);
}

/// Returns the running step of a job, its number and the time left.
fn step_text(job: &JobView) -> String {
    let steps = &job.overview.steps;
    let running = steps
        .iter()
        .position(|step| step.state == StepState::Running);
    let step = match running {
        Some(at) if steps.len() > 1 => {
            format!("Step {} of {}: {}", at + 1, steps.len(), steps[at].title)
        }
        Some(at) => steps[at].title.clone(),
        None => "Starting".into(),
    };
    match job.overview.left {
        Some(left) => format!("{step} – {}", time_left_text(left)),
        None => step,
    }
}

/// Returns how far a job is and the time left, as text.
pub(crate) fn percent_text(job: &JobView) -> String {
    let percent = job
        .overview
        .fraction
        .map(|fraction| format!("{:.0} %", (fraction * 100.0).floor()));
    let left = job.overview.left.map(time_left_text);
    match (percent, left) {
        (Some(percent), Some(left)) => format!("{percent}, {left}"),
        (Some(text), None) | (None, Some(text)) => text,
        (None, None) => "in progress".into(),
    }
}

/// Returns the progress of a job as text.
pub(crate) fn progress_text(job: &JobView) -> String {
    let steps = &job.overview.steps;
    let running = steps.iter().find(|step| step.state == StepState::Running);
    match running {
        Some(step) => format!("{}, {}", step.title, percent_text(job)),
        None => percent_text(job),
    }
}

/// Offers to continue work that was interrupted.
pub(crate) fn unfinished_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    commands: &mut Vec<Command>,
) {
    let Some(unfinished) = session.unfinished else {
        return;
    };
    ui.horizontal_wrapped(|ui| {
        let percent = (unfinished.fraction * 100.0).round();
        let place = if percent < 1.0 {
            "near its beginning".to_owned()
        } else {
            format!("at about {percent:.0} %")
        };
        ui.strong(format!("Reconstruction was interrupted {place}"));
        let go_on = ui
            .button("Continue")
            .on_hover_text("Continue with the same options; finished parts are used again")
            .accessible_name("Continue reconstruction");
        if go_on.clicked() {
            commands.push(unfinished.command.clone());
        }
        let dismiss = ui
            .button("Dismiss")
            .on_hover_text("Do not ask again; finished parts are kept")
            .accessible_name("Dismiss interrupted reconstruction");
        view.dismisses_unfinished |= dismiss.clicked();
    });
}

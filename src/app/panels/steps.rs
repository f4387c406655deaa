//! The way from frames to measures: one step is open at a time.

use egui::Ui;

use super::camera_models::camera_models_ui;
use super::conflicts::conflicts_ui;
use super::fuse::{fuse_advanced_ui, fuse_ui, results_ui};
use super::reconstruct::{reconstruct_advanced_ui, reconstruct_ui};
use super::ruler::scale_note_ui;
use super::step_header::{StepHeader, title};
use super::suggestions::{suggestions_ui, text_prompt_ui};
use super::track::{segmenter_ui, track_advanced_ui, track_ui};
use crate::action::Requests;
use crate::tooltips::{action_button, grouped, primary_button, section_heading};
use crate::{Action, SessionView, ViewState};
use ostra_project::workflow::{StepStatus, Workflow, WorkflowInput, WorkflowStep, workflow};
use ostra_session::JobTask;

fn workflow_of(session: &SessionView<'_>, view: &ViewState) -> Workflow {
    let last = session.project.frames.len().saturating_sub(1);
    let input = WorkflowInput {
        has_cloud: session.cloud.is_some(),
        range: view.track.from.unwrap_or(0)..=view.track.to.unwrap_or(last),
    };
    workflow(session.project, &input)
}

/// Returns whether a job of the step runs.
fn is_running(session: &SessionView<'_>, step: WorkflowStep) -> bool {
    let tasks: &[JobTask] = match step {
        WorkflowStep::Label => &[JobTask::Suggest, JobTask::Propose, JobTask::FindByText],
        WorkflowStep::Track => &[JobTask::Track],
        WorkflowStep::Geometry => &[JobTask::Reconstruct],
        WorkflowStep::Cloud => &[JobTask::Fuse],
        WorkflowStep::Measure => &[],
    };
    tasks.iter().any(|task| session.running(task).is_some())
}

fn header<'a>(
    session: &SessionView<'_>,
    view: &ViewState,
    (number, status): (usize, &'a StepStatus),
) -> StepHeader<'a> {
    StepHeader {
        step: status.step,
        number,
        state: status.state,
        is_running: is_running(session, status.step),
        is_open: view.steps.open == Some(status.step),
        text: &status.text,
    }
}

/// Draws the steps; a click on a header opens or closes its step.
pub(crate) fn steps_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    requests: &mut Requests,
) {
    let flow = workflow_of(session, view);
    view.steps.follow(flow.next);
    for (number, status) in (1..).zip(&flow.steps) {
        let header = header(session, view, (number, status));
        let is_open = header.is_open;
        if header.show(ui).clicked() {
            view.steps.toggle(status.step);
        }
        if is_open {
            egui::Frame::new()
                .inner_margin(egui::Margin {
                    left: 4,
                    right: 4,
                    top: 2,
                    bottom: 8,
                })
                .show(ui, |ui| {
                    ui.set_width(ui.available_width());
                    step_ui(ui, session, view, requests, status.step);
                });
        }
    }
}

/// Draws the icons of the steps in a narrow strip; a click expands the panel at the step.
pub(crate) fn step_strip_ui(ui: &mut Ui, session: &SessionView<'_>, view: &mut ViewState) {
    let flow = workflow_of(session, view);
    view.steps.follow(flow.next);
    for (number, status) in (1..).zip(&flow.steps) {
        let header = header(session, view, (number, status));
        if header.show_small(ui).clicked() {
            view.steps.open = None;
            view.steps.toggle(status.step);
            view.steps.is_expanded = true;
        }
    }
}

fn step_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    requests: &mut Requests,
    step: WorkflowStep,
) {
    ui.add(egui::Label::new(egui::RichText::new(purpose(step)).weak()).wrap());
    match step {
        WorkflowStep::Label => label_ui(ui, session, view, requests),
        WorkflowStep::Track => {
            track_ui(ui, session, view, &mut requests.actions);
            advanced(ui, session, step, |ui| track_advanced_ui(ui, session, view));
        }
        WorkflowStep::Geometry => {
            reconstruct_ui(ui, session, view, &mut requests.actions);
            camera_models_ui(ui, session, &mut requests.commands);
            advanced(ui, session, step, |ui| {
                reconstruct_advanced_ui(ui, session, view, &mut requests.actions);
            });
        }
        WorkflowStep::Cloud => {
            fuse_ui(ui, session, view, &mut requests.actions);
            if !session.conflicts.is_empty() {
                section_heading(ui, "Conflicts");
                conflicts_ui(ui, session, view, &mut requests.actions);
            }
            advanced(ui, session, step, |ui| fuse_advanced_ui(ui, view));
        }
        WorkflowStep::Measure => measure_ui(ui, session, view, requests),
    }
}

/// Returns the sentence that says what a step is for.
fn purpose(step: WorkflowStep) -> &'static str {
    match step {
        WorkflowStep::Label => {
            "Click on an object. Right click takes away, a drag draws a box, Ctrl+click labels another one."
        }
        WorkflowStep::Track => {
            "Carry the masks from keyframes to the other frames, then check them."
        }
        WorkflowStep::Geometry => {
            "Find out where each image was taken from and how far away everything is."
        }
        WorkflowStep::Cloud => "Fuse all frames into one cloud; each point gets a label by a vote.",
        WorkflowStep::Measure => "Measure lengths, areas and volumes per label, and write files.",
    }
}

/// Adds the settings that few people need, closed at first.
/// Draws the settings that few users change; they are closed in every project at first.
fn advanced(
    ui: &mut Ui,
    session: &SessionView<'_>,
    step: WorkflowStep,
    content: impl FnOnce(&mut Ui),
) {
    let salt = ("advanced", session.root, title(step));
    let header = egui::CollapsingHeader::new("Advanced").id_salt(salt);
    header.show_unindented(ui, content);
}

fn label_ui(ui: &mut Ui, session: &SessionView<'_>, view: &mut ViewState, requests: &mut Requests) {
    let action = Action::AddLabel;
    let tip = view.prefs.shortcuts.tip(ui.ctx(), action);
    let reason = action.unavailable(session, view);
    if primary_button(ui, "New label", &tip, reason).clicked() {
        requests.actions.push(action);
    }
    section_heading(ui, "Find by text");
    text_prompt_ui(ui, session, view, &mut requests.commands);
    section_heading(ui, "Suggestions");
    suggestions_ui(ui, session, view, requests);
    advanced(ui, session, WorkflowStep::Label, |ui| {
        segmenter_ui(ui, session, view);
    });
}

fn measure_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    requests: &mut Requests,
) {
    let action = Action::Export;
    let tip = view.prefs.shortcuts.tip(ui.ctx(), action);
    let reason = action.unavailable(session, view);
    if primary_button(ui, "Export…", &tip, reason).clicked() {
        requests.actions.push(action);
    }
    ui.horizontal(|ui| {
        let action = Action::ToggleMeasures;
        let reason = action.unavailable(session, view);
        let button = action_button(ui, &view.prefs.shortcuts, action, "Table of traits", reason);
        if button.clicked() {
            requests.actions.push(action);
        }
        let text = match session.cloud {
            Some(cloud) => format!("{} points", grouped(cloud.len())),
            None => "Fuse first".into(),
        };
        ui.weak(text);
    });
    scale_note_ui(ui, session, view);
    section_heading(ui, "Results");
    results_ui(ui, session);
}

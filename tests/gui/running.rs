//! Tests of what the window shows of running work, and of closing it meanwhile.

use std::time::Duration;

use egui::{Key, Modifiers, ViewportCommand, ViewportEvent, ViewportId};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use ostra_core::job::{JobId, Overview, ProgressReport, Step, StepState};
use ostra_project::ReconstructRequest;
use ostra_session::{Command, JobTask, JobView, Unfinished};

use crate::desk::{Desk, labels, press};

const CTRL: Modifiers = Modifiers {
    ctrl: true,
    command: true,
    ..Modifiers::NONE
};

fn step(title: &str, state: StepState) -> Step {
    Step {
        title: title.into(),
        state,
    }
}

/// Returns a reconstruction in its second of three steps.
/// Returns a reconstruction that runs.
pub fn reconstruction() -> JobView {
    JobView {
        id: JobId(3),
        title: "Reconstruct".into(),
        task: Some(JobTask::Reconstruct),
        report: ProgressReport {
            stage: "match".into(),
            done: 5,
            total: 10,
        },
        overview: Overview {
            fraction: Some(0.357),
            left: Some(Duration::from_secs(250)),
            steps: vec![
                step("Find features", StepState::Done),
                step("Match images", StepState::Running),
                step("Compute cameras", StepState::ToCome),
            ],
        },
        elapsed: Duration::from_secs(90),
    }
}

fn busy() -> Harness<'static, Desk> {
    Desk {
        jobs: vec![reconstruction()],
        ..Desk::sample()
    }
    .shown()
}

fn click(harness: &mut Harness<'_, Desk>, label: &str) {
    harness.get_by_label(label).click();
    harness.run_steps(3);
}

/// Runs a few frames and returns what they asked of the window.
fn window_commands(harness: &mut Harness<'_, Desk>) -> Vec<ViewportCommand> {
    let mut commands = Vec::new();
    for _ in 0..4 {
        harness.step();
        let root = &harness.output().viewport_output[&ViewportId::ROOT];
        commands.extend(root.commands.iter().cloned());
    }
    commands
}

fn close_window(harness: &mut Harness<'_, Desk>) -> Vec<ViewportCommand> {
    let root = harness.input_mut().viewports.entry(ViewportId::ROOT);
    root.or_default().events.push(ViewportEvent::Close);
    window_commands(harness)
}

#[test]
fn running_job_shows_its_steps_and_the_time_left() {
    let harness = busy();
    for label in [
        "Progress of Reconstruct",
        "Step 2 of 3: Match images – about 4 min left",
        "Find features: done",
        "Match images: running",
        "Compute cameras: to come",
        "You can go on labelling meanwhile",
        "Reconstruct: Match images, 35 %, about 4 min left",
    ] {
        let shown = labels(&harness);
        let is_shown =
            shown.iter().any(|name| name == label) || harness.query_by_label(label).is_some();
        assert!(is_shown, "{label} in {shown:?}");
    }
}

#[test]
fn closing_the_window_while_work_runs_asks() {
    let mut harness = busy();
    let commands = close_window(&mut harness);
    assert!(
        commands.contains(&ViewportCommand::CancelClose),
        "{commands:?}"
    );
    assert!(harness.query_by_label("Reconstruct is running").is_some());
    click(&mut harness, "Cancel");
    assert!(harness.query_by_label("Reconstruct is running").is_none());
    assert_eq!(harness.state().requested, []);
    // After the work has ended, nothing is asked.
    harness.state_mut().jobs.clear();
    assert!(window_commands(&mut harness).is_empty());
    assert!(!close_window(&mut harness).contains(&ViewportCommand::CancelClose));
}

#[test]
fn stop_and_quit_stops_the_work_and_then_closes_the_window() {
    let mut harness = busy();
    close_window(&mut harness);
    click(&mut harness, "Stop and quit");
    assert_eq!(harness.state().requested, [Command::Stop]);
    harness.state_mut().jobs.clear();
    assert!(window_commands(&mut harness).contains(&ViewportCommand::Close));
}

#[test]
fn project_can_be_closed_at_the_end_of_the_work() {
    let mut harness = busy();
    let ask = |harness: &mut Harness<'_, Desk>| {
        press(harness, CTRL, Key::W);
        harness.run_steps(3);
        assert_eq!(harness.state().requested, [], "held back");
    };
    ask(&mut harness);
    // Esc stays, and stops nothing.
    press(&mut harness, Modifiers::NONE, Key::Escape);
    harness.run_steps(3);
    assert!(harness.query_by_label("Reconstruct is running").is_none());
    assert_eq!(harness.state().requested, []);
    ask(&mut harness);
    click(&mut harness, "Wait for it, then close");
    assert_eq!(harness.state().requested, []);
    click(&mut harness, "Stay");
    harness.state_mut().jobs.clear();
    harness.run_steps(2);
    assert_eq!(harness.state().requested, [], "revoked");
    harness.state_mut().jobs.push(reconstruction());
    ask(&mut harness);
    click(&mut harness, "Wait for it, then close");
    harness.state_mut().jobs.clear();
    harness.run_steps(2);
    assert_eq!(harness.state().requested, [Command::Close]);
}

#[test]
fn interrupted_reconstruction_can_be_continued_with_its_options_or_dismissed() {
    let command = Command::Reconstruct(ReconstructRequest {
        every: 4,
        ..ReconstructRequest::default()
    });
    let unfinished = Unfinished {
        command: command.clone(),
        fraction: 0.25,
    };
    let mut harness = Desk {
        unfinished: Some(unfinished),
        ..Desk::sample()
    }
    .shown();
    assert!(
        harness
            .query_by_label("Reconstruction was interrupted at about 25 %")
            .is_some()
    );
    click(&mut harness, "Continue reconstruction");
    assert_eq!(harness.state().requested, [command]);
    click(&mut harness, "Dismiss interrupted reconstruction");
    assert!(harness.state().shell.view.dismisses_unfinished);
    harness.state_mut().unfinished.as_mut().unwrap().fraction = 0.001;
    harness.run_steps(2);
    harness.get_by_label("Reconstruction was interrupted near its beginning");
}

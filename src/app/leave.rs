//! The question before the window or the project is closed while work runs.

use egui::{Context, Ui, ViewportCommand};
use ostra_session::{Command, JobView};

use super::panels::percent_text;
use super::tooltips::modal;
use super::{Action, SessionView};

/// Time after which stopping a job loses work that is worth a question, in seconds.
const WORTH_ASKING: u64 = 5;

/// What would end the running jobs.
#[derive(Debug, Clone, PartialEq)]
enum Departure {
    /// Closing the window.
    Quit,
    /// A command that closes the project.
    Command(Box<Command>),
}

/// A departure that waits for an answer, or for the end of the running jobs.
#[derive(Debug, Default)]
pub(super) struct Leaving {
    asked: Option<Departure>,
    waiting: Option<Departure>,
}

impl Leaving {
    /// Returns `true` while the question is shown.
    pub(super) fn is_asking(&self) -> bool {
        self.asked.is_some()
    }

    /// Returns `true` if something is to happen at the end of the running jobs.
    pub(super) fn is_waiting(&self) -> bool {
        self.waiting.is_some()
    }

    /// Holds back the closing of the window while a job runs.
    pub(super) fn hold_back_quit(&mut self, ctx: &Context, jobs: &[JobView]) {
        let closes = ctx.input(|input| input.viewport().close_requested());
        if closes && job_to_wait_for(jobs).is_some() {
            ctx.send_viewport_cmd(ViewportCommand::CancelClose);
            self.asked = Some(Departure::Quit);
        }
    }

    /// Holds back commands that close the project while a job runs, and carries out what waits for
    /// the end of the jobs.
    pub(super) fn hold_back(&mut self, ctx: &Context, jobs: &[JobView], out: &mut Vec<Command>) {
        self.hold_back_quit(ctx, jobs);
        if job_to_wait_for(jobs).is_some() {
            if let Some(at) = out.iter().position(closes_project) {
                self.asked = Some(Departure::Command(Box::new(out.remove(at))));
            }
            return;
        }
        // If the work ends while the question is shown, nothing was decided yet, so all stays open.
        self.asked = None;
        match self.waiting.take() {
            Some(Departure::Quit) => ctx.send_viewport_cmd(ViewportCommand::Close),
            Some(Departure::Command(command)) => out.push(*command),
            None => {}
        }
    }
}

/// Returns the job whose work would be interrupted.
fn job_to_wait_for(jobs: &[JobView]) -> Option<&JobView> {
    jobs.iter()
        .find(|job| job.elapsed.as_secs() >= WORTH_ASKING)
}

/// Returns `true` if a command closes the open project.
fn closes_project(command: &Command) -> bool {
    matches!(
        command,
        Command::New(_)
            | Command::Open(_)
            | Command::View(_)
            | Command::Inspect(_)
            | Command::Close
    )
}

/// Asks whether to wait for a running job, to stop it, or to stay.
pub(super) fn leaving_ui(
    ui: &Ui,
    session: &SessionView<'_>,
    leaving: &mut Leaving,
    actions: &mut Vec<Action>,
) {
    let (Some(departure), Some(job)) = (&leaving.asked, job_to_wait_for(session.jobs)) else {
        return;
    };
    let (wait, stop) = match departure {
        Departure::Quit => ("Wait for it, then quit", "Stop and quit"),
        Departure::Command(command) if **command == Command::Close => {
            ("Wait for it, then close", "Stop and close")
        }
        Departure::Command(_) => ("Wait for it, then open", "Stop and open"),
    };
    let mut is_chosen = false;
    let response = modal(ui, "leaving", 420.0, |ui| {
        ui.heading(format!("{} is running", job.title));
        ui.label(percent_text(job));
        ui.label("If you stop it, what is finished is kept, and a reconstruction can be continued");
        ui.add_space(8.0);
        ui.horizontal(|ui| {
            let waits = ui.button(wait).on_hover_text("Go on working until then");
            let stops = ui.button(stop).on_hover_text("Keep what is finished");
            is_chosen = waits.clicked() || stops.clicked();
            if stops.clicked() {
                actions.push(Action::Stop);
            }
            ui.button("Cancel")
                .on_hover_text("Keep it running and stay (Esc)")
                .clicked()
        })
        .inner
    });
    if is_chosen {
        leaving.waiting = leaving.asked.take();
    } else if response.inner || response.should_close() {
        leaving.asked = None;
    }
}

/// Shows what happens at the end of the running jobs, with a button that revokes it.
pub(super) fn waiting_ui(ui: &mut Ui, leaving: &mut Leaving) {
    let text = match leaving.waiting {
        Some(Departure::Quit) => "OSTRA quits when the running work is done",
        Some(Departure::Command(_)) => "The project is closed when the running work is done",
        None => return,
    };
    ui.horizontal_wrapped(|ui| {
        ui.strong(text);
        let stays = ui
            .button("Stay")
            .on_hover_text("Keep it open when the work is done");
        if stays.clicked() {
            leaving.waiting = None;
        }
    });
}

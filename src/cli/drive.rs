use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow, bail};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::print::{print_text, print_to_stderr, printable, warn};
use super::stop;
use ostra_cloud::conflicts::FrameConflict;
use ostra_cloud::fuse::Votes;
use ostra_cloud::{LabelledCloud, LabelledMesh};
use ostra_core::job::{Step, StepState, time_left_text};
use ostra_frames::{Image, TurntableOptions};
use ostra_masks::LabelId;
use ostra_project::Project;
use ostra_session::{Command, Event, FoundThing, JobView, Session, Suggestion};

const NO_SURFACE: &str = "the project has no surface; create it with 'ostra fuse'";

/// A session that finishes each command before the next one.
pub(super) struct Driver {
    session: Session,
    lines: ProgressLines,
    /// Whether notices go to standard error instead of standard output.
    notices_on_stderr: bool,
}

impl Driver {
    /// Creates a session without a project.
    pub(super) fn new() -> Self {
        Self {
            session: Session::new(),
            lines: ProgressLines::default(),
            notices_on_stderr: false,
        }
    }

    /// Prints notices on standard error, for commands whose output is JSON.
    pub(super) fn with_notices_on_stderr(self) -> Self {
        Self {
            notices_on_stderr: true,
            ..self
        }
    }

    /// Opens a project for changes.
    pub(super) fn open(root: &Path) -> Result<Self> {
        let mut driver = Self::new();
        driver.act(Command::Open(root.to_owned()))?;
        match driver.session.view_reason() {
            None => Ok(driver),
            Some(why) => bail!("{}: the project cannot be changed: {why}", root.display()),
        }
    }

    /// Opens a project for viewing. Nothing is written to its folder.
    pub(super) fn view(root: &Path) -> Result<Self> {
        let mut driver = Self::new();
        driver.act(Command::View(root.to_owned()))?;
        Ok(driver)
    }

    /// Runs a command to its end.
    pub(super) fn act(&mut self, command: Command) -> Result<()> {
        self.session.act(command)?;
        self.settle()
    }

    /// Runs commands one after another and saves the project.
    ///
    /// Each step is in the journal by then, so a failure to save (a full disk) is only a warning.
    pub(super) fn act_and_save(self, commands: impl IntoIterator<Item = Command>) -> Result<()> {
        self.keep(commands).map(drop)
    }

    /// Runs commands as [`Self::act_and_save`], and returns the driver.
    pub(super) fn keep(mut self, commands: impl IntoIterator<Item = Command>) -> Result<Self> {
        for command in commands {
            self.act(command)?;
        }
        if let Err(error) = self.session.save() {
            warn(&format!(
                "{error:#}; all changes are in the project's journal, and the next command saves the rest"
            ));
        }
        Ok(self)
    }

    /// Returns the open project.
    pub(super) fn project(&self) -> Result<&Project> {
        self.session
            .project()
            .map(AsRef::as_ref)
            .context("no project is open")
    }

    /// Returns the labelled cloud.
    pub(super) fn cloud(&mut self) -> Result<Arc<LabelledCloud>> {
        if self.session.cloud().is_none() {
            self.settle()?;
        }
        self.session
            .cloud()
            .cloned()
            .context("the project has no cloud; create it with 'ostra fuse'")
    }

    /// Returns the votes of the cloud, once the cloud is loaded.
    pub(super) fn votes(&self) -> Option<Arc<Votes>> {
        self.session.votes().cloned()
    }

    /// Returns the surface that was fused with the cloud.
    pub(super) fn mesh(&mut self) -> Result<Arc<LabelledMesh>> {
        if self.session.mesh().is_none() {
            self.settle()?;
        }
        self.session.mesh().cloned().context(NO_SURFACE)
    }

    /// Returns the voxel size of the surface, in world units.
    pub(super) fn surface_voxel(&self) -> Result<f64> {
        self.session.surface_voxel().context(NO_SURFACE)
    }

    /// Returns the conflicts between mask and vote, by frame index.
    ///
    /// The map is empty if the votes of the cloud are not known.
    pub(super) fn conflicts(&mut self) -> Result<Arc<BTreeMap<usize, FrameConflict>>> {
        self.cloud()?;
        if self.session.conflicts().is_empty() {
            self.settle()?;
        }
        Ok(Arc::clone(self.session.conflicts()))
    }

    /// Returns the objects found by the last text prompt.
    pub(super) fn found(&self) -> Vec<FoundThing> {
        self.session
            .grounding()
            .map(|grounding| grounding.things.clone())
            .unwrap_or_default()
    }

    /// Returns the regions found by the last search for unlabelled objects.
    pub(super) fn suggestions(&self) -> &[Suggestion] {
        self.session.suggestions()
    }

    /// Fails if an export must not replace this file.
    pub(super) fn check_export(&self, file: &Path, overwrite: bool) -> Result<()> {
        self.session.check_export(file, overwrite)
    }

    /// Writes a video, image by image.
    pub(super) fn write_turntable(
        &mut self,
        path: &Path,
        options: TurntableOptions,
        overwrite: bool,
        draw: impl Fn(usize) -> Image + Send + 'static,
    ) -> Result<()> {
        self.session
            .write_turntable(path, options, overwrite, draw)?;
        self.settle()
    }

    fn settle(&mut self) -> Result<()> {
        let lines = &mut self.lines;
        let events = self.session.settle(|jobs| lines.update(jobs));
        lines.end();
        report(events, self.notices_on_stderr)
    }
}

/// Prints warnings and notices, and returns the first failure or stop as the error.
fn report(events: Vec<Event>, notices_on_stderr: bool) -> Result<()> {
    let mut outcome = Ok(());
    for event in events {
        match event {
            Event::Warning(text) | Event::Unchanged { text, .. } => warn(&text),
            Event::Paused { text, .. } if outcome.is_ok() => outcome = Err(anyhow!(text)),
            Event::Notice(text) if notices_on_stderr => {
                print_to_stderr(&format!("{}\n", printable(&text)));
            }
            Event::Notice(text) => print_text(&format!("{text}\n")),
            Event::Failed { error, .. } if outcome.is_ok() => outcome = Err(anyhow!(error)),
            Event::Stopped { .. } if outcome.is_ok() => outcome = Err(stop::Interrupted.into()),
            _ => {}
        }
    }
    outcome
}

/// Progress of jobs on standard error.
///
/// On a terminal one bar over all stages is redrawn, otherwise a new line is printed every few seconds.
#[derive(Default)]
pub(super) struct ProgressLines {
    shown: Option<(String, Instant)>,
    /// Bar on a terminal.
    bar: Option<ProgressBar>,
}

impl ProgressLines {
    /// Shows the progress of the first job. Returns `Break` after Ctrl+C.
    pub(super) fn update(&mut self, jobs: &[JobView]) -> ControlFlow<()> {
        if let Some(job) = jobs.first() {
            self.show(job);
        }
        if stop::is_requested() {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    }

    /// Clears the progress line.
    pub(super) fn end(&mut self) {
        self.shown = None;
        if let Some(bar) = self.bar.take() {
            bar.finish_and_clear();
        }
    }

    fn show(&mut self, job: &JobView) {
        let text = printable(&progress_text(job));
        // A terminal that cannot move its cursor (`TERM=dumb`) has no redrawn line either.
        let terminal = !ProgressDrawTarget::stderr().is_hidden();
        let pause = if terminal {
            Duration::from_millis(90)
        } else {
            Duration::from_secs(5)
        };
        let due = self
            .shown
            .as_ref()
            .map_or(job.elapsed >= pause, |(last, at)| {
                *last != text && at.elapsed() >= pause
            });
        if due {
            if terminal {
                let bar = self.bar.get_or_insert_with(terminal_bar);
                let fraction = job.overview.fraction.unwrap_or(0.0);
                bar.set_position((fraction * BAR_UNITS as f64) as u64);
                bar.set_message(text.clone());
            } else {
                print_to_stderr(&format!("{text}\n"));
            }
            self.shown = Some((text, Instant::now()));
        }
    }
}

/// Returns the stage of a job, what is done of it, and the time left of the whole job.
fn progress_text(job: &JobView) -> String {
    let (report, steps) = (&job.report, &job.overview.steps);
    let running = |step: &Step| step.state == StepState::Running;
    let mut text = match steps.iter().position(running) {
        Some(at) if steps.len() > 1 => {
            format!("{} of {}: {}", at + 1, steps.len(), steps[at].title)
        }
        _ if report.stage.is_empty() => job.title.clone(),
        _ => report.stage.clone(),
    };
    match report.total {
        0 => text.push_str(" …"),
        total => text.push_str(&format!(" {}/{total}", report.done)),
    }
    if let Some(left) = job.overview.left {
        text.push_str(&format!(", {}", time_left_text(left)));
    }
    text
}

/// Length of the bar of a job over all its stages.
const BAR_UNITS: u64 = 1000;

/// Returns a bar whose message is truncated to the width of the terminal.
fn terminal_bar() -> ProgressBar {
    let bar = ProgressBar::new(BAR_UNITS);
    match ProgressStyle::with_template("{bar:20} {percent:>3} % {wide_msg}") {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

/// Returns the id of the label with this name.
pub(super) fn label_id(project: &Project, name: &str) -> Result<LabelId> {
    let known = &project.labels;
    let label = known.by_name(name).with_context(|| {
        let names: Vec<&str> = known.iter().map(|label| label.name.as_str()).collect();
        format!(
            "there is no label '{name}' (labels: {}); add it with 'ostra label'",
            names.join(", ")
        )
    })?;
    Ok(label.id)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ostra_core::job::{JobId, Overview, ProgressReport};

    #[test]
    fn text_names_the_step_what_is_done_and_the_time_left() {
        let step = |title: &str, state| Step {
            title: title.into(),
            state,
        };
        let mut job = JobView {
            id: JobId(1),
            title: "Reconstruct".into(),
            task: None,
            report: ProgressReport {
                stage: "match".into(),
                done: 3,
                total: 10,
            },
            overview: Overview {
                fraction: Some(0.4),
                left: Some(Duration::from_secs(130)),
                steps: vec![
                    step("Find features", StepState::Done),
                    step("Match images", StepState::Running),
                ],
            },
            elapsed: Duration::from_secs(60),
        };
        assert_eq!(
            progress_text(&job),
            "2 of 2: Match images 3/10, about 2 min left"
        );
        job.report.total = 0;
        job.overview = Overview::default();
        assert_eq!(progress_text(&job), "match …");
    }
}

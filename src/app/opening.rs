//! What leads to an open project: dropped files, the form of a new project, recent projects, and
//! the example.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Result;
use egui::Context;

use crate::{Dialog, NewProjectForm, Severity, ViewState};
use ostra_core::job::{JobId, Progress};
use ostra_frames::FrameStore;
use ostra_session::{
    Command, Event, Images, JobCompletion, JobKind, JobTask, Recent, RecentProject, RecentProjects,
    Session, Survey,
};

/// Makes the example project in a folder and returns the project's folder.
///
/// A project that was made before is returned as it is.
pub type MakeExample = fn(&Path, &Progress) -> Result<PathBuf>;

/// Memory for the decoded images of a form, in bytes.
const PIXEL_BYTES: usize = 64 << 20;

/// State of what leads to an open project.
pub(super) struct Opening {
    recent_projects: RecentProjects,
    survey: Option<Arc<Survey>>,
    images: Option<Images>,
    /// Job that creates the project of the form, or adds its frames.
    creation: Option<JobId>,
    example: Option<(PathBuf, MakeExample)>,
    example_job: Option<JobId>,
}

impl Opening {
    pub(super) fn new(ctx: &Context) -> Self {
        let waker = ctx.clone();
        Self {
            recent_projects: RecentProjects::new(move || waker.request_repaint()),
            survey: None,
            images: None,
            creation: None,
            example: None,
            example_job: None,
        }
    }

    pub(super) fn recent_projects(&self) -> Option<&BTreeMap<PathBuf, RecentProject>> {
        Some(self.recent_projects.known())
    }

    pub(super) fn survey(&self) -> Option<&Arc<Survey>> {
        self.survey.as_ref()
    }

    pub(super) fn images(&self) -> Option<&Images> {
        self.images.as_ref()
    }

    /// Takes what was found in the files of the form, and loads its images.
    fn show_survey(&mut self, found: Option<Arc<Survey>>, ctx: &Context) {
        let is_same = match (&self.survey, &found) {
            (Some(shown), Some(found)) => Arc::ptr_eq(shown, found),
            (None, None) => true,
            _ => false,
        };
        if is_same {
            return;
        }
        let (waker, store) = (ctx.clone(), Arc::new(FrameStore::new(PIXEL_BYTES)));
        self.images = found.as_ref().map(|found| {
            Images::of(Arc::clone(&found.frames), store, move || {
                waker.request_repaint();
            })
        });
        self.survey = found;
    }

    /// Offers an example project, which is made in `folder`.
    pub(super) fn offer_example(&mut self, folder: PathBuf, make: MakeExample) {
        self.example = Some((folder, make));
    }

    /// Requests what the first page and the form of a new project show.
    pub(super) fn follow(
        &mut self,
        session: &mut Session,
        view: &mut ViewState,
        recent: &Recent,
        ctx: &Context,
    ) {
        let request = view.new_project.survey_request();
        let found = request
            .filter(|_| is_form_open(view))
            .and_then(|request| session.survey(request).cloned());
        self.show_survey(found, ctx);
        if session.root().is_none() && session.inspected().is_none() {
            self.recent_projects.request(recent.paths());
        }
        view.has_example = self.example.is_some();
        if std::mem::take(&mut view.wants_example) {
            self.start_example(session);
        }
    }

    /// Remembers the job that executes the request of the form; the form shows why it failed.
    pub(super) fn note_creation(
        &mut self,
        started: Result<Option<JobId>>,
        view: &mut ViewState,
    ) -> Result<Option<JobId>> {
        if !view.new_project.is_sent() {
            return started;
        }
        match started {
            Ok(job) => {
                self.creation = job;
                Ok(job)
            }
            Err(error) => {
                view.new_project.resume(Some(format!("{error:#}")));
                Ok(None)
            }
        }
    }

    /// Takes an event of the job of the form or the example.
    ///
    /// Returns whether nothing else has to be done with it.
    pub(super) fn take(&mut self, event: &Event, view: &mut ViewState) -> bool {
        match event {
            Event::Failed { job, error, .. } if self.creation == Some(*job) => {
                self.creation = None;
                view.new_project.resume(Some(error.clone()));
                return true;
            }
            Event::Stopped { job, .. } if self.creation == Some(*job) => {
                self.creation = None;
                view.new_project.resume(None);
                return true;
            }
            Event::Finished { job, .. } if self.creation == Some(*job) => {
                self.creation = None;
                view.new_project = NewProjectForm::default();
                if is_form_open(view) {
                    view.dialog = None;
                }
            }
            Event::Finished { job, .. } if self.example_job == Some(*job) => {
                self.example_job = None;
                if let Some((folder, _)) = &self.example {
                    let text = format!("The example plant is in {}", folder.display());
                    view.notices.tell(Severity::Note, text);
                }
            }
            Event::Opened(_) | Event::Closed => self.recent_projects.clear(),
            _ => {}
        }
        false
    }

    /// Starts the job that makes the example project and then opens it.
    fn start_example(&mut self, session: &mut Session) {
        let Some((folder, make)) = self.example.clone() else {
            return;
        };
        let job = session.start(JobTask::Example, JobKind::Short, move |context| {
            let root = make(&folder, &context.progress)?;
            Ok(Box::new(move |session: &mut Session| {
                if session.root() != Some(root.as_path()) {
                    session.act(Command::Open(root))?;
                }
                Ok(())
            }) as JobCompletion)
        });
        self.example_job = Some(job);
    }
}

/// Returns the folder of the example in the user's documents, or else the data folder.
pub(super) fn example_folder() -> Option<PathBuf> {
    let place = dirs::document_dir().or_else(dirs::data_dir)?;
    Some(place.join("OSTRA example"))
}

fn is_form_open(view: &ViewState) -> bool {
    matches!(view.dialog, Some(Dialog::NewProject | Dialog::AddFrames))
}

/// Opens files dropped on the window as if they were given on the command line.
///
/// Files that are dropped on the form of a new project are added to it.
pub(super) fn open_dropped(ctx: &Context, view: &mut ViewState) -> Option<Command> {
    let dropped: Vec<PathBuf> = ctx.input(|input| {
        let files = input.raw.dropped_files.iter();
        files.map(|file| file.path().to_owned()).collect()
    });
    if dropped.is_empty() || !is_form_open(view) {
        return open_paths(dropped, view);
    }
    if !view.new_project.is_sent() {
        view.new_project.add_paths(dropped);
    }
    None
}

/// Opens the form of a new project with files.
///
/// Returns the command that opens a project or point cloud instead, if the only file is one.
pub(super) fn open_paths(paths: Vec<PathBuf>, view: &mut ViewState) -> Option<Command> {
    let is_cloud = |path: &Path| {
        path.extension()
            .is_some_and(|ending| ending.eq_ignore_ascii_case("ply"))
    };
    match &paths[..] {
        [] => None,
        [path] if is_cloud(path) => Some(Command::Inspect(path.clone())),
        [path] if path.join("project.toml").is_file() => Some(Command::Open(path.clone())),
        _ => {
            view.new_project = NewProjectForm::with_paths(paths);
            view.dialog = Some(Dialog::NewProject);
            None
        }
    }
}

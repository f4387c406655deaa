use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, bail};

use crate::job_task::JobTitle;
use crate::jobs::{Completion, Job, JobContext, JobKind, Jobs};
use crate::live_preview::LivePreview;
use crate::live_revote::LiveRevote;
use crate::prepared::Prompting;
use crate::queries::{
    AllPointsKey, Angles, AnglesKey, ChosenPoints, CloudQuery, Conflicts, ConflictsKey,
    DepthPixels, DepthPoints, DepthPointsKey, FramePointsKey, InstancesKey, MeshKey, SelectionKey,
    SparseKey, SurfaceKey, Survey, SurveyRequest, TraitsKey, VoteMismatchKey,
};
use crate::query::Query;
use crate::track_run::TrackRun;
use crate::unfinished::{RunningRecord, Unfinished};
use crate::{
    Event, Grounding, JobView, PromptRequest, ProposedInstances, Recipe, SparseReconstruction,
    Suggestion,
};
use ostra_cloud::LabelledMesh;
use ostra_cloud::measure::TraitRow;
use ostra_core::job::JobId;
use ostra_frames::FrameStore;
use ostra_masks::{Region, RunMask};
use ostra_project::OpenProject;
use ostra_project::{Edit, Project};

/// Memory for decoded images and depths, in bytes.
pub(crate) const PIXEL_BYTES: usize = 256 << 20;

/// Applies the result of a job to the session.
pub type JobCompletion = Completion<Session>;

/// The open project (if any), its running jobs, and its data in memory.
///
/// Window and command line use the project through a session. [`Session::act`] executes commands,
/// and [`Session::poll`] applies the results of jobs. Neither waits.
pub struct Session {
    pub(crate) open: Option<OpenProject>,
    pub(crate) inspected: Option<PathBuf>,
    pub(crate) store: Arc<FrameStore>,
    pub(crate) jobs: Jobs<Session>,
    pub(crate) events: Vec<Event>,
    pub(crate) recipe: Recipe,
    pub(crate) background: Background,
    pub(crate) track: Option<TrackRun>,
    pub(crate) prompting: Prompting,
    pub(crate) suggestions: Vec<Suggestion>,
    pub(crate) grounding: Option<Grounding>,
    pub(crate) unfinished: Option<Unfinished>,
    pub(crate) running_record: Option<RunningRecord>,
}

/// Results of background jobs for the open project.
#[derive(Default)]
pub(crate) struct Background {
    pub(crate) cloud: CloudQuery,
    pub(crate) mesh: Query<MeshKey, LabelledMesh>,
    pub(crate) surface: Query<SurfaceKey, LabelledMesh>,
    pub(crate) sparse: Query<SparseKey, SparseReconstruction>,
    pub(crate) frame_points: Query<FramePointsKey, DepthPixels>,
    pub(crate) all_points: Query<AllPointsKey, DepthPixels>,
    pub(crate) depth_points: Query<DepthPointsKey, DepthPoints>,
    pub(crate) instances: Query<InstancesKey, ProposedInstances>,
    pub(crate) conflicts: Query<ConflictsKey, Conflicts>,
    pub(crate) vote_mismatch: Query<VoteMismatchKey, Region>,
    pub(crate) traits: Query<TraitsKey, Vec<TraitRow>>,
    pub(crate) angles: Query<AnglesKey, Angles>,
    pub(crate) selection: Query<SelectionKey, ChosenPoints>,
    pub(crate) prompt_preview: Query<PromptRequest, Option<Arc<RunMask>>>,
    pub(crate) survey: Query<SurveyRequest, Survey>,
    pub(crate) revote: LiveRevote,
    pub(crate) preview: LivePreview,
}

impl Default for Session {
    fn default() -> Self {
        Self::new()
    }
}

impl Session {
    /// Creates a session without an open project.
    #[must_use]
    pub fn new() -> Self {
        Self {
            open: None,
            inspected: None,
            store: Arc::new(FrameStore::new(PIXEL_BYTES)),
            jobs: Jobs::default(),
            events: Vec::new(),
            recipe: Recipe {
                format: 1,
                commands: Vec::new(),
            },
            background: Background::default(),
            track: None,
            prompting: Prompting::default(),
            suggestions: Vec::new(),
            grounding: None,
            unfinished: None,
            running_record: None,
        }
    }

    /// Drops data that is kept only for speed.
    ///
    /// These are the prepared frames, the geometry of the scene and the cloud. All of them are made
    /// or loaded again when requested.
    pub fn release_memory(&mut self) {
        self.prompting.release_memory();
        self.background.cloud.loaded.clear();
    }

    /// Returns the open project.
    #[must_use]
    pub fn project(&self) -> Option<&Arc<Project>> {
        self.open.as_ref().map(OpenProject::project)
    }

    /// Returns the open project's folder.
    #[must_use]
    pub fn root(&self) -> Option<&Path> {
        self.open.as_ref().map(OpenProject::root)
    }

    /// Returns why no step can be made, or `None` if the project is open for writing.
    #[must_use]
    pub fn view_reason(&self) -> Option<&str> {
        self.open.as_ref()?.view_reason()
    }

    /// Returns the path of the inspected PLY.
    #[must_use]
    pub fn inspected(&self) -> Option<&Path> {
        self.inspected.as_deref()
    }

    /// Returns the store that loads images and depths.
    #[must_use]
    pub fn store(&self) -> &Arc<FrameStore> {
        &self.store
    }

    /// Returns the pixels of a frame's mask before the last step that changed them.
    ///
    /// Returns `None` if no known step did.
    #[must_use]
    pub fn mask_before(&self, frame: usize) -> Option<Arc<RunMask>> {
        self.open.as_ref()?.history().mask_before(frame)
    }

    /// Returns the title of the step that [`Command::Undo`](crate::Command::Undo) would revert.
    #[must_use]
    pub fn undo_title(&self) -> Option<&str> {
        self.open
            .as_ref()?
            .history()
            .last()
            .map(|step| step.title.as_str())
    }

    /// Returns the title of the step that [`Command::Redo`](crate::Command::Redo) would repeat.
    #[must_use]
    pub fn redo_title(&self) -> Option<&str> {
        self.open
            .as_ref()?
            .history()
            .next()
            .map(|step| step.title.as_str())
    }

    /// Returns the running jobs that the user requested, oldest first.
    #[must_use]
    pub fn jobs(&self) -> Vec<JobView> {
        self.jobs
            .iter()
            .filter(|job| job.is_shown())
            .map(Job::view)
            .collect()
    }

    /// Sets a function that is called on a worker's thread when [`Self::poll`] has work to do.
    pub fn set_waker(&mut self, wake: impl Fn() + Send + 'static) {
        self.jobs.set_waker(wake);
    }

    /// Returns the open project for making steps.
    pub(crate) fn opened(&mut self) -> Result<&mut OpenProject> {
        self.open
            .as_mut()
            .context("no project is open; open one first")
    }

    /// Returns a snapshot of the open project.
    pub(crate) fn snapshot(&self) -> Result<Arc<Project>> {
        self.project()
            .cloned()
            .context("no project is open; open one first")
    }

    /// Makes a step and reports it.
    pub(crate) fn commit(&mut self, title: &str, edits: Vec<Edit>) -> Result<()> {
        if self.opened()?.commit(title, edits)? {
            self.report_changed();
        }
        Ok(())
    }

    /// Reports a change and publishes the current files of results.
    pub(crate) fn report_changed(&mut self) {
        self.events.push(Event::Changed);
        let published = self.open.as_mut().map_or(Ok(()), OpenProject::publish);
        if let Err(error) = published {
            self.events.push(Event::Warning(format!("{error:#}")));
        }
    }

    /// Checks that no long job is running, because only one may run at a time.
    pub(crate) fn check_no_long_job(&self) -> Result<()> {
        let running = self
            .jobs
            .iter()
            .find(|job| job.kind == JobKind::Long && job.is_shown());
        running.map_or(Ok(()), |job| {
            bail!("'{}' is still running; wait for it or stop it", job.title)
        })
    }

    pub(crate) fn warn_all(&mut self, warnings: Vec<String>) {
        self.events.extend(warnings.into_iter().map(Event::Warning));
    }

    /// Starts a job and reports it.
    pub fn start(
        &mut self,
        title: impl Into<JobTitle>,
        kind: JobKind,
        work: impl FnOnce(&JobContext<Self>) -> Result<JobCompletion> + Send + 'static,
    ) -> JobId {
        let title = title.into();
        let text = title.text.clone();
        let id = self.jobs.start(title, kind, work);
        if !kind.is_background() {
            self.events.push(Event::Started {
                job: id,
                title: text,
            });
        }
        id
    }

    pub(crate) fn stop_all(&mut self) {
        self.jobs
            .iter()
            .filter(|job| job.is_shown())
            .for_each(Job::stop);
    }

    /// Stops all jobs and drops their further results.
    pub(crate) fn discard_jobs(&mut self) {
        self.jobs.iter_mut().for_each(Job::discard);
    }
}

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, Result, bail};

use super::angles::AngleMeasuring;
use super::cloud::{CloudSlot, CloudState};
use super::commands::TrackRun;
use super::contradicted::Contradicted;
use super::doubt::Doubts;
use super::following::Following;
use super::growing::Growing;
use super::hover::Hover;
use super::jobs::{Job, Jobs, Kind, Landing};
use super::measuring::Measuring;
use super::on_demand::OnDemand;
use super::prepared::PreparedFrames;
use super::selected::Selected;
use super::surfaces::Surfaces;
use super::{Grounding, InstancesRequest, ProposedInstances, Recipe, SparseModel, Suggestion};
use crate::{Event, JobView};
use ostra_compute::nn::take_fall_backs;
use ostra_core::job::JobId;
use ostra_frames::{FrameStore, take_video_damage};
use ostra_masks::RunMask;
use ostra_project::OpenProject;
use ostra_project::{Edit, Project};
use ostra_tracking::supervoxels::GeometrySegmenter;

/// Bytes of decoded pictures and depths kept.
pub(super) const PIXEL_BYTES: usize = 256 << 20;

/// Bytes of frames made ready for prompts.
const PREPARED_BYTES: usize = 384 << 20;

/// How often [`Session::settle`] looks at progress while nothing happens.
const GLANCE: Duration = Duration::from_millis(50);

/// What window and command line talk to: the open project (or none), running jobs, loaded engines and caches.
/// [`Session::act`] takes wishes, [`Session::poll`] takes in what jobs have done; neither waits.
pub struct Session {
    pub(super) open: Option<OpenProject>,
    pub(super) inspected: Option<PathBuf>,
    pub(super) store: Arc<FrameStore>,
    pub(super) jobs: Jobs,
    pub(super) events: Vec<Event>,
    pub(super) recipe: Recipe,
    pub(super) cloud: CloudSlot,
    pub(super) surfaces: Surfaces,
    pub(super) following: Following,
    pub(super) doubts: Doubts,
    pub(super) contradicted: Contradicted,
    pub(super) measuring: Measuring,
    pub(super) angle_measuring: AngleMeasuring,
    pub(super) growing: Growing,
    pub(super) sparse: OnDemand<u64, SparseModel>,
    pub(super) proposed: OnDemand<(CloudState, InstancesRequest), ProposedInstances>,
    pub(super) track: Option<TrackRun>,
    pub(super) prepared: Arc<PreparedFrames>,
    /// The segmenter that knows where the project's frames were taken from.
    pub(super) geometry: Option<Arc<GeometrySegmenter>>,
    /// Name of the frame that was last asked to be made ready.
    pub(super) preparing: Option<String>,
    pub(super) hover: Hover,
    pub(super) selected: Selected,
    /// Which segmenter `auto` was last said to be.
    pub(super) told_segmenter: Option<&'static str>,
    pub(super) interactions: usize,
    pub(super) suggestions: Vec<Suggestion>,
    pub(super) grounding: Option<Grounding>,
}

/// The job that writes a checkpoint while work goes on.
const CHECKPOINT: &str = "checkpoint";

impl Default for Session {
    fn default() -> Self {
        Self::new()
    }
}

impl Session {
    /// A session in which nothing is open.
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
            cloud: CloudSlot::default(),
            surfaces: Surfaces::default(),
            following: Following::default(),
            doubts: Doubts::default(),
            contradicted: Contradicted::default(),
            measuring: Measuring::default(),
            angle_measuring: AngleMeasuring::default(),
            growing: Growing::default(),
            sparse: OnDemand::default(),
            proposed: OnDemand::default(),
            track: None,
            prepared: Arc::new(PreparedFrames::new(PREPARED_BYTES)),
            geometry: None,
            preparing: None,
            hover: Hover::default(),
            selected: Selected::default(),
            told_segmenter: None,
            interactions: 0,
            suggestions: Vec::new(),
            grounding: None,
        }
    }

    /// Drops what is only kept to answer sooner: frames made ready for prompts, the geometry of the scene and the cloud. All
    /// of it comes back when it is asked for.
    pub fn release_memory(&mut self) {
        self.prepared = Arc::new(PreparedFrames::new(PREPARED_BYTES));
        self.geometry = None;
        self.cloud = CloudSlot::default();
    }

    /// The open project.
    #[must_use]
    pub fn project(&self) -> Option<&Arc<Project>> {
        self.open.as_ref().map(OpenProject::project)
    }

    /// The open project's folder.
    #[must_use]
    pub fn root(&self) -> Option<&Path> {
        self.open.as_ref().map(OpenProject::root)
    }

    /// Why no step can be made in the open project; `None` where it is open for writing.
    #[must_use]
    pub fn view_reason(&self) -> Option<&str> {
        self.open.as_ref()?.view_reason()
    }

    /// The labelled PLY that is open alone.
    #[must_use]
    pub fn inspected(&self) -> Option<&Path> {
        self.inspected.as_deref()
    }

    /// Where pictures and depths are loaded.
    #[must_use]
    pub fn store(&self) -> &Arc<FrameStore> {
        &self.store
    }

    /// How often the user clicked, boxed, painted or corrected since the session began; what was undone counts.
    #[must_use]
    pub fn interactions(&self) -> usize {
        self.interactions
    }

    /// The pixels of a frame's mask before the last step that changed them; `None` when no step known did.
    #[must_use]
    pub fn mask_before(&self, frame: usize) -> Option<Arc<RunMask>> {
        self.open.as_ref()?.history().mask_before(frame)
    }

    /// What [`Command::Undo`](super::Command::Undo) would take back.
    #[must_use]
    pub fn undo_title(&self) -> Option<&str> {
        self.open
            .as_ref()?
            .history()
            .last()
            .map(|step| step.title.as_str())
    }

    /// What [`Command::Redo`](super::Command::Redo) would do again.
    #[must_use]
    pub fn redo_title(&self) -> Option<&str> {
        self.open
            .as_ref()?
            .history()
            .next()
            .map(|step| step.title.as_str())
    }

    /// The jobs that run, oldest first, without those that nobody asked for.
    #[must_use]
    pub fn jobs(&self) -> Vec<JobView> {
        self.jobs
            .iter()
            .filter(|job| job.is_shown())
            .map(Job::view)
            .collect()
    }

    /// Asks a job to stop; it keeps what it finished.
    pub fn stop(&mut self, job: JobId) {
        if let Some(job) = self.jobs.get_mut(job) {
            job.stop();
        }
    }

    /// `wake` is called, on a worker's thread, whenever [`Self::poll`] has something to take in.
    pub fn set_waker(&mut self, wake: impl Fn() + Send + 'static) {
        self.jobs.set_waker(wake);
    }

    /// Takes in what jobs have done since the last call and says what happened. Never waits for a job.
    pub fn poll(&mut self) -> Vec<Event> {
        self.jobs.note_ended();
        self.warn_all(take_fall_backs());
        self.warn_all(take_video_damage());
        while let Some((job, landing)) = self.jobs.next_piece() {
            self.take_piece(job, landing);
        }
        while let Some((job, result)) = self.jobs.take_ended() {
            self.take_result(job, result);
        }
        self.gather_growing();
        self.load_wanted_cloud();
        self.load_wanted_surfaces();
        self.load_wanted_sparse();
        self.load_wanted_instances();
        self.follow_wanted();
        self.compare_wanted();
        self.contradict_wanted();
        self.measure_wanted();
        self.measure_wanted_angles();
        self.checkpoint_if_due();
        std::mem::take(&mut self.events)
    }

    /// Works until no job runs and gives all that happened: how the command line waits. `on_progress` sees the
    /// running jobs about twenty times a second; `Break` stops them.
    pub fn settle(
        &mut self,
        mut on_progress: impl FnMut(&[JobView]) -> ControlFlow<()>,
    ) -> Vec<Event> {
        let mut events = self.poll();
        while self.jobs.iter().next().is_some() {
            if on_progress(&self.jobs()).is_break() {
                self.stop_all();
                // Before the job notices the stop: whoever waits for it may not wait that long.
                if let Err(error) = self.save_tracked(true) {
                    self.events.push(Event::Warning(format!("{error:#}")));
                }
            }
            if let Some((job, landing)) = self.jobs.wait(GLANCE) {
                self.take_piece(job, landing);
            }
            events.extend(self.poll());
        }
        events
    }

    /// Writes a checkpoint of the open project now, on this thread: `project.toml` and the masks are as the project
    /// is. Without it nothing is lost either; the journal has every step.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn save(&mut self) -> Result<()> {
        self.wait_for_checkpoint();
        self.open.as_mut().map_or(Ok(()), OpenProject::save_now)
    }

    /// The open project, for making steps.
    pub(super) fn opened(&mut self) -> Result<&mut OpenProject> {
        self.open
            .as_mut()
            .context("no project is open; open one first")
    }

    /// A snapshot of the open project.
    pub(super) fn snapshot(&self) -> Result<Arc<Project>> {
        self.project()
            .cloned()
            .context("no project is open; open one first")
    }

    /// Makes a step and tells of it.
    pub(super) fn commit(&mut self, title: &str, edits: Vec<Edit>) -> Result<()> {
        if self.opened()?.commit(title, edits)? {
            self.tell_changed();
        }
        Ok(())
    }

    /// Tells of a change; the files of results follow it.
    pub(super) fn tell_changed(&mut self) {
        self.events.push(Event::Changed);
        let published = self.open.as_mut().map_or(Ok(()), OpenProject::publish);
        if let Err(error) = published {
            self.events.push(Event::Warning(format!("{error:#}")));
        }
    }

    /// Long jobs run one at a time.
    pub(super) fn check_no_long_job(&self) -> Result<()> {
        let running = self
            .jobs
            .iter()
            .find(|job| job.kind == Kind::Long && job.is_shown());
        running.map_or(Ok(()), |job| {
            bail!("'{}' is still running; wait for it or stop it", job.title)
        })
    }

    pub(super) fn warn_all(&mut self, warnings: Vec<String>) {
        self.events.extend(warnings.into_iter().map(Event::Warning));
    }

    /// Starts a job and tells of it.
    pub fn start(
        &mut self,
        title: &str,
        kind: Kind,
        work: impl FnOnce(&super::jobs::Link) -> Result<Landing> + Send + 'static,
    ) -> JobId {
        let id = self.jobs.start(title, kind, work);
        if kind != Kind::Background {
            self.events.push(Event::Started {
                job: id,
                title: title.to_owned(),
            });
        }
        id
    }

    pub(super) fn stop_all(&mut self) {
        self.jobs
            .iter()
            .filter(|job| job.is_shown())
            .for_each(Job::stop);
    }

    /// Stops all jobs of what is open now; what they still bring is not taken in.
    pub(super) fn discard_jobs(&mut self) {
        for job in self.jobs.iter_mut() {
            job.stop();
            job.discarded = true;
        }
    }

    /// Waits until no checkpoint is being written: two must not write the same files.
    pub(super) fn wait_for_checkpoint(&mut self) {
        let is_checkpoint = |job: &Job| job.title == CHECKPOINT && !job.has_ended();
        self.jobs.note_ended();
        while self.jobs.iter().any(is_checkpoint) {
            if let Some((job, landing)) = self.jobs.wait(GLANCE) {
                self.take_piece(job, landing);
            }
            self.jobs.note_ended();
        }
    }

    fn take_piece(&mut self, job: JobId, landing: Landing) {
        let wanted = self.jobs.get_mut(job).is_some_and(|job| !job.discarded);
        if !wanted {
            return;
        }
        if let Err(error) = landing(self)
            && let Some(job) = self.jobs.get_mut(job)
        {
            job.stop();
            job.failure.get_or_insert(error);
        }
    }

    /// Takes in how a job ended. Of one whose results are no longer wanted nobody hears any more.
    fn take_result(&mut self, mut job: Job, result: Result<Landing>) {
        if job.discarded {
            self.track.take_if(|run| run.is_of(job.id));
            return;
        }
        let (stopped, paused) = (job.is_stopped(), self.paused(job.id));
        let saved = self.end_track(job.id);
        let failure = job.failure.take().or(saved.err());
        let failed = failure.is_some();
        let result = match failure {
            Some(error) => Err(error),
            None => result.and_then(|landing| landing(self)),
        };
        let (id, title) = (job.id, job.title);
        let event = match result {
            Ok(()) => {
                self.record(job.command);
                paused.unwrap_or(Event::Finished { job: id, title })
            }
            Err(_) if stopped && !failed => paused.unwrap_or(Event::Stopped { job: id, title }),
            Err(error) => Event::Failed {
                job: id,
                title,
                error: format!("{error:#}"),
            },
        };
        match (job.kind, event) {
            (Kind::Background, Event::Failed { error, .. }) => {
                self.events.push(Event::Warning(error));
            }
            (Kind::Background, _) => {}
            (_, event) => self.events.push(event),
        }
    }

    fn checkpoint_if_due(&mut self) {
        let running = self.jobs.iter().any(|job| job.title == CHECKPOINT);
        let Some(open) = self.open.as_mut().filter(|open| open.is_due() && !running) else {
            return;
        };
        match open.checkpoint() {
            Ok(checkpoint) => {
                self.start(CHECKPOINT, Kind::Background, move |link| {
                    let written = checkpoint.write(&link.progress)?;
                    Ok(Box::new(move |session: &mut Self| {
                        session.opened()?.written(written)
                    }))
                });
            }
            Err(error) => self.events.push(Event::Warning(format!("{error:#}"))),
        }
    }
}

impl Drop for Session {
    /// Stops what runs and writes a last checkpoint; if that fails, the journal still has every step.
    fn drop(&mut self) {
        self.discard_jobs();
        if !std::thread::panicking() {
            let _ = self.save();
        }
    }
}

use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use anyhow::Result;

use crate::job_task::{JobTask, JobTitle};
use crate::{Command, JobView};
use ostra_core::job::JobId;
use ostra_core::job::{Progress, Running, Stopped};
use ostra_masks::LabelId;

/// Number of results that may be queued before worker threads have to wait.
const WAITING: usize = 64;

/// Applies a result of a job to the state `S`, on the thread that owns it.
///
/// It must be quick.
pub type Completion<S> = Box<dyn FnOnce(&mut S) -> Result<()> + Send>;

/// Kind of a job, which determines what may run concurrently and how it is reported.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JobKind {
    /// Long work; only one such job runs at a time.
    Long,
    /// Work that may run next to other jobs.
    Short,
    /// The answer to a prompt; a newer prompt for the same label and frame replaces it.
    Prompt {
        /// Frame number.
        frame: usize,
        /// Label that is prompted.
        label: LabelId,
    },
    /// Work that the user did not request: not shown, and its failures are only warnings.
    Background,
    /// Writes a checkpoint of the project in the background.
    Checkpoint,
    /// Prepares frames that may be prompted next, in the background.
    ReadAhead,
}

impl JobKind {
    /// Returns whether the job is work that the user did not request.
    pub fn is_background(self) -> bool {
        matches!(self, Self::Background | Self::Checkpoint | Self::ReadAhead)
    }
}

/// A running job.
pub struct Job<S> {
    /// Id of the job.
    pub id: JobId,
    /// Title to display.
    pub title: String,
    /// Task by which panels find the job.
    pub task: Option<JobTask>,
    /// Kind of the job.
    pub kind: JobKind,
    /// Command that the job executes, for the recipe.
    pub command: Option<Command>,
    /// Whether its results are no longer wanted.
    pub discarded: bool,
    /// Error of a partial result that could not be applied.
    pub failure: Option<anyhow::Error>,
    started: Instant,
    running: Running<Result<Completion<S>>>,
    outcome: Option<Result<Completion<S>>>,
}

/// A message from a worker thread.
enum JobMessage<S> {
    /// A partial result of a job.
    Piece(JobId, Completion<S>),
    /// A job has ended or is about to end.
    Ended,
}

/// All running jobs, whose results are applied to a state `S`.
pub struct Jobs<S> {
    running: Vec<Job<S>>,
    last: u64,
    sender: SyncSender<JobMessage<S>>,
    receiver: Receiver<JobMessage<S>>,
    waker: Waker,
}

type Waker = Arc<Mutex<Option<Box<dyn Fn() + Send>>>>;

/// The context of a job's work: its progress and the channel to the state.
pub struct JobContext<S> {
    /// Reports progress and detects a stop.
    pub progress: Progress,
    id: JobId,
    sender: SyncSender<JobMessage<S>>,
    waker: Waker,
}

impl<S> JobContext<S> {
    /// Returns the id of the job.
    pub fn id(&self) -> JobId {
        self.id
    }

    /// Returns whether a window shows partial results.
    ///
    /// Otherwise a script waits for the end of the job.
    pub fn is_watched(&self) -> bool {
        self.waker
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .is_some()
    }

    /// Sends a partial result while the work goes on.
    ///
    /// # Errors
    ///
    /// Returns [`Stopped`] if the state no longer exists.
    pub fn send(
        &self,
        completion: impl FnOnce(&mut S) -> Result<()> + Send + 'static,
    ) -> Result<(), Stopped> {
        self.sender
            .send(JobMessage::Piece(self.id, Box::new(completion)))
            .map_err(|_| Stopped)?;
        wake(&self.waker);
        Ok(())
    }
}

impl<S> Drop for JobContext<S> {
    /// Wakes the owner of the state, even if the work panicked.
    ///
    /// If the queue is full, the owner has been woken already.
    fn drop(&mut self) {
        let _ = self.sender.try_send(JobMessage::Ended);
        wake(&self.waker);
    }
}

fn wake(waker: &Waker) {
    if let Some(wake) = waker
        .lock()
        .unwrap_or_else(PoisonError::into_inner)
        .as_ref()
    {
        wake();
    }
}

impl<S> Default for Jobs<S> {
    fn default() -> Self {
        let (sender, receiver) = sync_channel(WAITING);
        Self {
            running: Vec::new(),
            last: 0,
            sender,
            receiver,
            waker: Waker::default(),
        }
    }
}

impl<S: 'static> Jobs<S> {
    /// Starts work on its own thread.
    pub fn start(
        &mut self,
        title: impl Into<JobTitle>,
        kind: JobKind,
        work: impl FnOnce(&JobContext<S>) -> Result<Completion<S>> + Send + 'static,
    ) -> JobId {
        let JobTitle { text: title, task } = title.into();
        self.last += 1;
        let id = JobId(self.last);
        let (sender, waker) = (self.sender.clone(), Arc::clone(&self.waker));
        let context = move |progress: &Progress| JobContext {
            progress: progress.clone(),
            id,
            sender,
            waker,
        };
        let running = Running::spawn(&title, Progress::default(), move |progress| {
            work(&context(progress))
        });
        let started = Instant::now();
        self.running.push(Job {
            id,
            title,
            task,
            kind,
            command: None,
            discarded: false,
            failure: None,
            started,
            running,
            outcome: None,
        });
        id
    }

    /// Sets a function that a worker's thread calls whenever a result is ready to be applied.
    pub fn set_waker(&mut self, wake: impl Fn() + Send + 'static) {
        *self.waker.lock().unwrap_or_else(PoisonError::into_inner) = Some(Box::new(wake));
    }

    /// Returns the next queued partial result, without waiting.
    pub fn next_piece(&mut self) -> Option<(JobId, Completion<S>)> {
        std::iter::from_fn(|| self.receiver.try_recv().ok()).find_map(|message| match message {
            JobMessage::Piece(job, completion) => Some((job, completion)),
            JobMessage::Ended => None,
        })
    }

    /// Waits for a message of a worker for at most `longest`.
    ///
    /// Returns the partial result in the message, if there is one.
    pub fn wait(&mut self, longest: Duration) -> Option<(JobId, Completion<S>)> {
        match self.receiver.recv_timeout(longest) {
            Ok(JobMessage::Piece(job, completion)) => Some((job, completion)),
            Ok(JobMessage::Ended)
            | Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => None,
        }
    }

    /// Notes which jobs have ended.
    ///
    /// All their partial results are queued by then. Apply these before calling
    /// [`Self::take_ended`].
    pub fn note_ended(&mut self) {
        for job in self.running.iter_mut().filter(|job| job.outcome.is_none()) {
            job.outcome = job
                .running
                .try_take()
                .map(|result| result.map_err(anyhow::Error::from).flatten());
        }
    }

    /// Removes a job that was noted as ended, and returns it with its result.
    pub fn take_ended(&mut self) -> Option<(Job<S>, Result<Completion<S>>)> {
        let place = self.running.iter().position(|job| job.outcome.is_some())?;
        let mut job = self.running.remove(place);
        let outcome = job.outcome.take()?;
        Some((job, outcome))
    }

    /// Returns the running job with this id.
    pub fn get_mut(&mut self, id: JobId) -> Option<&mut Job<S>> {
        self.running.iter_mut().find(|job| job.id == id)
    }

    /// Returns all running jobs, oldest first.
    pub fn iter_mut(&mut self) -> impl Iterator<Item = &mut Job<S>> {
        self.running.iter_mut()
    }

    /// Returns whether a job is still working, that is, was not noted as ended.
    pub fn is_working(&self, id: JobId) -> bool {
        self.iter().any(|job| job.id == id && !job.has_ended())
    }

    /// Asks a job to stop; its results so far are kept.
    pub fn stop(&self, id: JobId) {
        self.iter().filter(|job| job.id == id).for_each(Job::stop);
    }

    /// Asks a job to stop, and drops its further results.
    pub fn discard(&mut self, id: JobId) {
        let job = self.iter_mut().find(|job| job.id == id);
        job.into_iter().for_each(Job::discard);
    }

    /// Returns all running jobs, oldest first.
    pub fn iter(&self) -> impl Iterator<Item = &Job<S>> {
        self.running.iter()
    }
}

impl<S: 'static> Job<S> {
    /// Asks the job to stop.
    pub fn stop(&self) {
        self.running.stop();
    }

    /// Asks the job to stop, and drops its further results.
    pub fn discard(&mut self) {
        self.stop();
        self.discarded = true;
    }

    /// Returns whether the user requested the job and still wants it.
    pub fn is_shown(&self) -> bool {
        !self.kind.is_background() && !self.discarded
    }

    /// Returns whether the job was asked to stop.
    pub fn is_stopped(&self) -> bool {
        self.running.progress().check().is_err()
    }

    /// Returns whether the job was noted as ended.
    pub fn has_ended(&self) -> bool {
        self.outcome.is_some()
    }

    /// Returns the job as it is displayed.
    pub fn view(&self) -> JobView {
        JobView {
            id: self.id,
            title: self.title.clone(),
            task: self.task.clone(),
            report: self.running.progress().report(),
            overview: self.running.progress().overview(),
            elapsed: self.started.elapsed(),
        }
    }
}

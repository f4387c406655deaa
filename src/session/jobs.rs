use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use anyhow::Result;

use crate::job_task::{JobTask, JobTitle};
use crate::{Command, JobView};
use ostra_core::job::JobId;
use ostra_core::job::{Progress, Running, Stopped};
use ostra_masks::LabelId;

/// How many results may wait for the state before workers wait for it.
const WAITING: usize = 64;

/// Applies a result of a job to the state `S`, on the thread that owns it. Must be quick.
pub type Completion<S> = Box<dyn FnOnce(&mut S) -> Result<()> + Send>;

/// What a job is for, which decides what runs next to it and who hears of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JobKind {
    /// Long work, of which one runs at a time.
    Long,
    /// Work that runs next to others.
    Short,
    /// The answer to a prompt; a newer prompt for the same label and frame takes its place.
    Prompt {
        /// Frame number.
        frame: usize,
        /// For which label.
        label: LabelId,
    },
    /// Work that the user did not ask for: not shown, its failures are warnings at most.
    Background,
    /// Writes a checkpoint of the project; in the background.
    Checkpoint,
    /// Prepares frames that may be prompted next; in the background.
    ReadAhead,
}

impl JobKind {
    /// Whether it is work that the user did not ask for.
    pub fn is_background(self) -> bool {
        matches!(self, Self::Background | Self::Checkpoint | Self::ReadAhead)
    }
}

/// A job that runs.
pub struct Job<S> {
    /// Which it is.
    pub id: JobId,
    /// What it is, for people.
    pub title: String,
    /// The task that panels find it by.
    pub task: Option<JobTask>,
    /// What it is for.
    pub kind: JobKind,
    /// The command that it carries out, for the recipe.
    pub command: Option<Command>,
    /// Its results are no longer wanted.
    pub discarded: bool,
    /// A part of its result could not be applied.
    pub failure: Option<anyhow::Error>,
    started: Instant,
    running: Running<Result<Completion<S>>>,
    outcome: Option<Result<Completion<S>>>,
}

/// A message from a worker thread.
enum JobMessage<S> {
    /// A part of a job's result.
    Piece(JobId, Completion<S>),
    /// A job ended, or soon will have.
    Ended,
}

/// All running jobs, whose results are applied to a state `S`, and the way back from their threads.
pub struct Jobs<S> {
    running: Vec<Job<S>>,
    last: u64,
    sender: SyncSender<JobMessage<S>>,
    receiver: Receiver<JobMessage<S>>,
    waker: Waker,
}

type Waker = Arc<Mutex<Option<Box<dyn Fn() + Send>>>>;

/// What a job's work is given: its progress and the way back to the state.
pub struct JobContext<S> {
    /// Reports progress and notices a stop.
    pub progress: Progress,
    id: JobId,
    sender: SyncSender<JobMessage<S>>,
    waker: Waker,
}

impl<S> JobContext<S> {
    /// The job whose work this is.
    pub fn id(&self) -> JobId {
        self.id
    }

    /// Whether a window shows what the work brings, not a script that waits for its end.
    pub fn is_watched(&self) -> bool {
        self.waker
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .is_some()
    }

    /// Hands over a part of the result while the work goes on.
    ///
    /// # Errors
    /// [`Stopped`] when the state is gone.
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
    /// Wakes the owner of the state, also when the work panicked. A full queue has woken it already.
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
    /// Starts work on a thread of its own.
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

    /// Calls `wake` on a worker's thread whenever there is a result to apply.
    pub fn set_waker(&mut self, wake: impl Fn() + Send + 'static) {
        *self.waker.lock().unwrap_or_else(PoisonError::into_inner) = Some(Box::new(wake));
    }

    /// The next piece that waits; never waits itself.
    pub fn next_piece(&mut self) -> Option<(JobId, Completion<S>)> {
        std::iter::from_fn(|| self.receiver.try_recv().ok()).find_map(|message| match message {
            JobMessage::Piece(job, completion) => Some((job, completion)),
            JobMessage::Ended => None,
        })
    }

    /// Waits until a worker has something, `longest` at most. Gives a piece that came with it.
    pub fn wait(&mut self, longest: Duration) -> Option<(JobId, Completion<S>)> {
        match self.receiver.recv_timeout(longest) {
            Ok(JobMessage::Piece(job, completion)) => Some((job, completion)),
            Ok(JobMessage::Ended)
            | Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => None,
        }
    }

    /// Notes which jobs ended. All their pieces are waiting by then: take these in before [`Self::take_ended`].
    pub fn note_ended(&mut self) {
        for job in self.running.iter_mut().filter(|job| job.outcome.is_none()) {
            job.outcome = job
                .running
                .try_take()
                .map(|result| result.map_err(anyhow::Error::from).flatten());
        }
    }

    /// Takes out a job that was noted to have ended, with its result.
    pub fn take_ended(&mut self) -> Option<(Job<S>, Result<Completion<S>>)> {
        let place = self.running.iter().position(|job| job.outcome.is_some())?;
        let mut job = self.running.remove(place);
        let outcome = job.outcome.take()?;
        Some((job, outcome))
    }

    /// The running job of this id.
    pub fn get_mut(&mut self, id: JobId) -> Option<&mut Job<S>> {
        self.running.iter_mut().find(|job| job.id == id)
    }

    /// All running jobs, oldest first.
    pub fn iter_mut(&mut self) -> impl Iterator<Item = &mut Job<S>> {
        self.running.iter_mut()
    }

    /// Whether a job still works; one that was noted to have ended does not.
    pub fn is_working(&self, id: JobId) -> bool {
        self.iter().any(|job| job.id == id && !job.has_ended())
    }

    /// Asks a job to stop; it keeps what it finished.
    pub fn stop(&self, id: JobId) {
        self.iter().filter(|job| job.id == id).for_each(Job::stop);
    }

    /// Asks a job to stop, and drops what it still brings.
    pub fn discard(&mut self, id: JobId) {
        let job = self.iter_mut().find(|job| job.id == id);
        job.into_iter().for_each(Job::discard);
    }

    /// All running jobs, oldest first.
    pub fn iter(&self) -> impl Iterator<Item = &Job<S>> {
        self.running.iter()
    }
}

impl<S: 'static> Job<S> {
    /// Asks it to stop.
    pub fn stop(&self) {
        self.running.stop();
    }

    /// Asks it to stop, and drops what it still brings.
    pub fn discard(&mut self) {
        self.stop();
        self.discarded = true;
    }

    /// Whether the user asked for it and still wants it.
    pub fn is_shown(&self) -> bool {
        !self.kind.is_background() && !self.discarded
    }

    /// Whether it was asked to stop.
    pub fn is_stopped(&self) -> bool {
        self.running.progress().check().is_err()
    }

    /// Whether it was noted to have ended.
    pub fn has_ended(&self) -> bool {
        self.outcome.is_some()
    }

    /// As it is shown.
    pub fn view(&self) -> JobView {
        JobView {
            id: self.id,
            title: self.title.clone(),
            task: self.task.clone(),
            report: self.running.progress().report(),
            elapsed: self.started.elapsed(),
        }
    }
}

use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use anyhow::Result;

use super::{Command, Session};
use crate::JobView;
use ostra_core::job::JobId;
use ostra_core::job::{Progress, Running, Stopped};
use ostra_masks::LabelId;

/// How many results may wait for the session before workers wait for it.
const WAITING: usize = 64;

/// What a job does to the session when its result is taken in, on the session's thread: quick.
pub type Landing = Box<dyn FnOnce(&mut Session) -> Result<()> + Send>;

/// What a job is to the session.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Long work, of which one runs at a time.
    Long,
    /// Work beside others.
    Short,
    /// The answer to a prompt; a newer prompt for the same label and frame takes its place.
    Prompt {
        /// Frame number.
        frame: usize,
        /// For which label.
        label: LabelId,
    },
    /// Work that nobody asked for (reading ahead, checkpoints): not shown, its failures are warnings at most.
    Background,
}

/// A job that runs.
pub struct Job {
    /// Which it is.
    pub id: JobId,
    /// What it is, for people.
    pub title: String,
    /// What it is to the session.
    pub kind: Kind,
    /// The command that it carries out, for the recipe.
    pub command: Option<Command>,
    /// Its results are no longer wanted.
    pub discarded: bool,
    /// A piece of its result could not be taken in.
    pub failure: Option<anyhow::Error>,
    started: Instant,
    running: Running<Result<Landing>>,
    outcome: Option<Result<Landing>>,
}

/// Something for the session to take in.
pub enum News {
    /// A piece of a job's result.
    Piece(JobId, Landing),
    /// A job ended, or soon will have.
    Ended,
}

/// All running jobs and the way back from their threads.
pub struct Jobs {
    running: Vec<Job>,
    last: u64,
    sender: SyncSender<News>,
    receiver: Receiver<News>,
    waker: Waker,
}

type Waker = Arc<Mutex<Option<Box<dyn Fn() + Send>>>>;

/// What a job's work is given: its progress and the way to the session.
pub struct Link {
    /// Reports and notices a stop.
    pub progress: Progress,
    job: JobId,
    sender: SyncSender<News>,
    waker: Waker,
}

impl Link {
    /// The job whose work this is.
    pub fn job(&self) -> JobId {
        self.job
    }

    /// Whether somebody looks on while the work goes on: a window, not a script.
    pub fn is_watched(&self) -> bool {
        self.waker
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .is_some()
    }

    /// Hands a piece of the result over while the work goes on.
    ///
    /// # Errors
    /// [`Stopped`] when nobody takes it any more.
    pub fn send(
        &self,
        landing: impl FnOnce(&mut Session) -> Result<()> + Send + 'static,
    ) -> Result<(), Stopped> {
        self.sender
            .send(News::Piece(self.job, Box::new(landing)))
            .map_err(|_| Stopped)?;
        wake(&self.waker);
        Ok(())
    }
}

impl Drop for Link {
    /// Tells the session to look, also when the work panicked. A full queue makes it look anyway.
    fn drop(&mut self) {
        let _ = self.sender.try_send(News::Ended);
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

impl Default for Jobs {
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

impl Jobs {
    /// Starts work on a thread of its own.
    pub fn start(
        &mut self,
        title: &str,
        kind: Kind,
        work: impl FnOnce(&Link) -> Result<Landing> + Send + 'static,
    ) -> JobId {
        self.last += 1;
        let id = JobId(self.last);
        let (sender, waker) = (self.sender.clone(), Arc::clone(&self.waker));
        let link = move |progress: &Progress| Link {
            progress: progress.clone(),
            job: id,
            sender,
            waker,
        };
        let running = Running::spawn(title, Progress::default(), move |progress| {
            work(&link(progress))
        });
        let started = Instant::now();
        self.running.push(Job {
            id,
            title: title.to_owned(),
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

    /// Calls `wake` on a worker's thread whenever there is something to take in.
    pub fn set_waker(&mut self, wake: impl Fn() + Send + 'static) {
        *self.waker.lock().unwrap_or_else(PoisonError::into_inner) = Some(Box::new(wake));
    }

    /// The next piece that waits; never waits itself.
    pub fn next_piece(&mut self) -> Option<(JobId, Landing)> {
        std::iter::from_fn(|| self.receiver.try_recv().ok()).find_map(|news| match news {
            News::Piece(job, landing) => Some((job, landing)),
            News::Ended => None,
        })
    }

    /// Waits until a worker has something, `longest` at most. Gives a piece that came with it.
    pub fn wait(&mut self, longest: Duration) -> Option<(JobId, Landing)> {
        match self.receiver.recv_timeout(longest) {
            Ok(News::Piece(job, landing)) => Some((job, landing)),
            Ok(News::Ended) | Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => {
                None
            }
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
    pub fn take_ended(&mut self) -> Option<(Job, Result<Landing>)> {
        let place = self.running.iter().position(|job| job.outcome.is_some())?;
        let mut job = self.running.remove(place);
        let outcome = job.outcome.take()?;
        Some((job, outcome))
    }

    /// The running job of this id.
    pub fn get_mut(&mut self, id: JobId) -> Option<&mut Job> {
        self.running.iter_mut().find(|job| job.id == id)
    }

    /// All running jobs, oldest first.
    pub fn iter_mut(&mut self) -> impl Iterator<Item = &mut Job> {
        self.running.iter_mut()
    }

    /// All running jobs, oldest first.
    pub fn iter(&self) -> impl Iterator<Item = &Job> {
        self.running.iter()
    }
}

impl Job {
    /// Asks it to stop.
    pub fn stop(&self) {
        self.running.stop();
    }

    /// Whether anybody asked for it.
    pub fn is_shown(&self) -> bool {
        self.kind != Kind::Background && !self.discarded
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
            report: self.running.progress().report(),
            elapsed: self.started.elapsed(),
        }
    }
}

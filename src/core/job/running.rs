use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};

use super::Progress;

/// Reason why a job has no result.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum JobError {
    /// The job panicked because of a bug. Panics are caught here and nowhere else.
    #[error("a bug in this program stopped the work ({what}); please report it")]
    Panicked {
        /// Message of the panic.
        what: String,
    },
    /// The job was removed from the queue before it began, or its result was taken already.
    #[error("the work was dropped from the queue; start it again")]
    Discarded,
    /// The system could not start another thread.
    #[error("no thread can be started ({what}); close other programs")]
    NoThread {
        /// Message of the system.
        what: String,
    },
}

/// A job on another thread and its future result.
///
/// Dropping it lets the job continue without an observer.
#[derive(Debug)]
pub struct Running<T> {
    progress: Progress,
    outcome: Receiver<Result<T, JobError>>,
}

impl<T: Send + 'static> Running<T> {
    /// Runs `work` on its own thread, named `name`.
    pub fn spawn(
        name: &str,
        progress: Progress,
        work: impl FnOnce(&Progress) -> T + Send + 'static,
    ) -> Self {
        let (running, task, sender) = Self::prepare(progress, work);
        if let Err(error) = std::thread::Builder::new().name(name.into()).spawn(task) {
            let _ = sender.try_send(Err(JobError::NoThread {
                what: error.to_string(),
            }));
        }
        running
    }

    /// Returns the handle, the task for a thread to run, and a sender for a result in its place.
    pub(super) fn prepare(
        progress: Progress,
        work: impl FnOnce(&Progress) -> T + Send + 'static,
    ) -> (
        Self,
        impl FnOnce() + Send + 'static,
        SyncSender<Result<T, JobError>>,
    ) {
        let (sender, outcome) = sync_channel(1);
        let (own_progress, own_sender) = (progress.clone(), sender.clone());
        let task = move || {
            let result = catch_unwind(AssertUnwindSafe(|| work(&own_progress)));
            let _ = own_sender.try_send(result.map_err(|panic| JobError::Panicked {
                what: message_of(panic.as_ref()),
            }));
        };
        (Self { progress, outcome }, task, sender)
    }

    /// Returns the result, once; `None` while the job is running.
    pub fn try_take(&self) -> Option<Result<T, JobError>> {
        match self.outcome.try_recv() {
            Ok(result) => Some(result),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => Some(Err(JobError::Discarded)),
        }
    }

    /// Waits for the result; not for use on the window's thread.
    ///
    /// # Errors
    /// [`JobError`] if there is no result.
    pub fn join(self) -> Result<T, JobError> {
        self.outcome.recv().unwrap_or(Err(JobError::Discarded))
    }

    /// Requests that the job stops at its next step.
    pub fn stop(&self) {
        self.progress.stop();
    }

    /// Returns the current progress.
    #[must_use]
    pub fn progress(&self) -> &Progress {
        &self.progress
    }
}

fn message_of(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "no message".into())
}

/// Identifies a job of a session; never used twice.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct JobId(pub u64);

#[cfg(test)]
mod tests {
    use super::super::Stopped;
    use super::*;

    #[test]
    fn result_is_returned_once() {
        let running = Running::spawn("adder", Progress::default(), |_| 2 + 2);
        let result = loop {
            if let Some(result) = running.try_take() {
                break result;
            }
            std::thread::yield_now();
        };
        assert_eq!(result, Ok(4));
        assert_eq!(running.join(), Err(JobError::Discarded));
    }

    #[test]
    fn stop_reaches_the_job_through_its_progress() {
        let running = Running::spawn("counter", Progress::default(), |progress| {
            let mut done = 0;
            while progress.step(done, 0).is_ok() {
                done += 1;
            }
            progress.check()
        });
        running.stop();
        assert_eq!(running.join(), Ok(Err(Stopped)));
    }

    #[test]
    fn panic_is_returned_as_an_error() {
        let running = Running::spawn("broken", Progress::default(), |_| -> u8 {
            panic!("index {} is out", 7)
        });
        assert_eq!(
            running.join(),
            Err(JobError::Panicked {
                what: "index 7 is out".into()
            })
        );
    }
}

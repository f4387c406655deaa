use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};

use super::Progress;

/// Why a piece of work gave no result.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum JobError {
    /// It hit a bug. Caught here and nowhere else.
    #[error("a bug in this program stopped the work ({what}); please report it")]
    Panicked {
        /// The message of the panic.
        what: String,
    },
    /// It was taken out of the queue before it began, or its result was taken already.
    #[error("the work was dropped from the queue")]
    Discarded,
    /// The system gives no more threads.
    #[error("no thread can be started ({what}); close other programs")]
    NoThread {
        /// What the system said.
        what: String,
    },
}

/// A piece of work on another thread, and its result once there is one. Dropping it lets the work go on unseen.
#[derive(Debug)]
pub struct Running<T> {
    progress: Progress,
    outcome: Receiver<Result<T, JobError>>,
}

impl<T: Send + 'static> Running<T> {
    /// Runs `work` on a thread of its own, named `name`.
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

    /// The handle, the task that a thread must run, and a way to answer in its place.
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

    /// The result, once: `None` while the work goes on.
    pub fn try_take(&self) -> Option<Result<T, JobError>> {
        match self.outcome.try_recv() {
            Ok(result) => Some(result),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => Some(Err(JobError::Discarded)),
        }
    }

    /// Waits for the result. Not for the window's thread.
    ///
    /// # Errors
    /// [`JobError`] when there is none.
    pub fn join(self) -> Result<T, JobError> {
        self.outcome.recv().unwrap_or(Err(JobError::Discarded))
    }

    /// Asks the work to stop at its next step.
    pub fn stop(&self) {
        self.progress.stop();
    }

    /// How far it is.
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
    fn the_result_comes_once() {
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
    fn a_stop_reaches_the_work_through_its_progress() {
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
    fn a_panic_is_a_result() {
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

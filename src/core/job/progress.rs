use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// The running work was asked to stop; whatever was finished before is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("stopped")]
pub struct Stopped;

/// A snapshot of the progress of a job.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ProgressReport {
    /// Name of the current stage, e.g. `track`; empty before the first stage.
    pub stage: String,
    /// Units of this stage that are done.
    pub done: usize,
    /// Total units of this stage; 0 = unknown.
    pub total: usize,
}

/// A handle shared by a job and its observers, for reporting progress and requesting a stop.
#[derive(Debug, Clone, Default)]
pub struct Progress {
    shared: Arc<ProgressState>,
    /// State of the jobs that this one is a part of.
    wholes: Vec<Arc<ProgressState>>,
}

#[derive(Debug, Default)]
struct ProgressState {
    stop: AtomicBool,
    report: Mutex<ProgressReport>,
}

impl Progress {
    /// Returns a handle for a part of this job.
    ///
    /// Stopping the whole stops the part; stopping the part does not stop the whole. Progress of
    /// the part is not reported by the whole.
    #[must_use]
    #[inline]
    pub fn part(&self) -> Self {
        let wholes = self
            .wholes
            .iter()
            .chain([&self.shared])
            .map(Arc::clone)
            .collect();
        Self {
            shared: Arc::default(),
            wholes,
        }
    }

    /// Starts a new stage without progress.
    ///
    /// # Errors
    /// [`Stopped`] if a stop was requested.
    #[inline]
    pub fn stage(&self, name: &str) -> Result<(), Stopped> {
        let mut report = self.lock();
        report.stage.clear();
        report.stage.push_str(name);
        (report.done, report.total) = (0, 0);
        drop(report);
        self.check()
    }

    /// Reports `done` of `total` units of the stage.
    ///
    /// Call it at least every 100 ms of work.
    ///
    /// # Errors
    /// [`Stopped`] if a stop was requested.
    #[inline]
    pub fn step(&self, done: usize, total: usize) -> Result<(), Stopped> {
        let mut report = self.lock();
        (report.done, report.total) = (done, total);
        drop(report);
        self.check()
    }

    /// Checks for a stop without reporting; cheap enough for inner loops over rows.
    ///
    /// # Errors
    /// [`Stopped`] if a stop was requested.
    #[inline]
    pub fn check(&self) -> Result<(), Stopped> {
        let is_stopped = |shared: &Arc<ProgressState>| shared.stop.load(Ordering::Relaxed);
        if is_stopped(&self.shared) || self.wholes.iter().any(is_stopped) {
            Err(Stopped)
        } else {
            Ok(())
        }
    }

    /// Requests that the job stops at its next step.
    #[inline]
    pub fn stop(&self) {
        self.shared.stop.store(true, Ordering::Relaxed);
    }

    /// Returns the current progress.
    #[must_use]
    #[inline]
    pub fn report(&self) -> ProgressReport {
        self.lock().clone()
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, ProgressReport> {
        self.shared
            .report
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn part_stops_alone_or_with_the_whole() {
        let whole = Progress::default();
        let (first, second) = (whole.part(), whole.part());
        first.stop();
        assert_eq!(
            (first.check(), second.step(1, 2), whole.check()),
            (Err(Stopped), Ok(()), Ok(()))
        );
        assert_eq!(whole.report(), ProgressReport::default());
        let inner = second.part();
        whole.stop();
        assert_eq!(
            (second.check(), inner.check()),
            (Err(Stopped), Err(Stopped))
        );
    }
}

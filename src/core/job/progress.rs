use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// The user asked the running work to stop; what was finished before is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("stopped")]
pub struct Stopped;

/// A snapshot of how far a piece of work is.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ProgressReport {
    /// What is being done now, e.g. `track`; empty before the first stage.
    pub stage: String,
    /// Units done of this stage.
    pub done: usize,
    /// Units of this stage in all; 0 = not known.
    pub total: usize,
}

/// A handle shared by a job and those who watch it: reports progress and notices stop in one call.
#[derive(Debug, Clone, Default)]
pub struct Progress {
    shared: Arc<Shared>,
    /// Those of the works that this one is a part of.
    wholes: Vec<Arc<Shared>>,
}

#[derive(Debug, Default)]
struct Shared {
    stop: AtomicBool,
    report: Mutex<ProgressReport>,
}

impl Progress {
    /// A handle for a part of this work: a stop of the whole stops the part, a stop of the part leaves the whole going;
    /// what the part reports is not the whole's.
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

    /// Starts a new stage with nothing done.
    ///
    /// # Errors
    /// [`Stopped`] when a stop was asked for.
    #[inline]
    pub fn stage(&self, name: &str) -> Result<(), Stopped> {
        let mut report = self.lock();
        report.stage.clear();
        report.stage.push_str(name);
        (report.done, report.total) = (0, 0);
        drop(report);
        self.check()
    }

    /// Reports `done` of `total` units of the stage; call at least every 100 ms of work.
    ///
    /// # Errors
    /// [`Stopped`] when a stop was asked for.
    #[inline]
    pub fn step(&self, done: usize, total: usize) -> Result<(), Stopped> {
        let mut report = self.lock();
        (report.done, report.total) = (done, total);
        drop(report);
        self.check()
    }

    /// Notices a stop without reporting; cheap enough for inner loops over rows.
    ///
    /// # Errors
    /// [`Stopped`] when a stop was asked for.
    #[inline]
    pub fn check(&self) -> Result<(), Stopped> {
        let is_stopped = |shared: &Arc<Shared>| shared.stop.load(Ordering::Relaxed);
        if is_stopped(&self.shared) || self.wholes.iter().any(is_stopped) {
            Err(Stopped)
        } else {
            Ok(())
        }
    }

    /// Asks the work to stop at its next step.
    #[inline]
    pub fn stop(&self) {
        self.shared.stop.store(true, Ordering::Relaxed);
    }

    /// How far the work is.
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
    fn a_part_stops_alone_or_with_the_whole() {
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

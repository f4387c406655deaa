use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use super::schedule::{PlannedStage, Schedule, Step, StepTime};

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

/// How far a job is over all its stages.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Overview {
    /// Share of the job that is done, from 0 to 1. It never decreases. `None` if nothing says so.
    pub fraction: Option<f64>,
    /// Time left at the measured pace; `None` while it is not known.
    pub left: Option<Duration>,
    /// Steps done, running and to come, in order.
    pub steps: Vec<Step>,
}

/// A handle shared by a job and its observers, for reporting progress and requesting a stop.
#[derive(Debug, Clone, Default)]
pub struct Progress {
    shared: Arc<ProgressState>,
    /// ReportState of the jobs that this one is a part of.
    wholes: Vec<Arc<ProgressState>>,
}

#[derive(Debug)]
struct ProgressState {
    stop: AtomicBool,
    state: Mutex<ReportState>,
    begun: Instant,
}

#[derive(Debug, Default)]
struct ReportState {
    report: ProgressReport,
    schedule: Schedule,
}

impl Default for ProgressState {
    fn default() -> Self {
        Self {
            stop: AtomicBool::default(),
            state: Mutex::default(),
            begun: Instant::now(),
        }
    }
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

    /// Announces the stages to come, in order.
    ///
    /// The weights divide one bar over all of them. Stages that are already running or done stay.
    pub fn plan(&self, stages: &[PlannedStage]) {
        self.lock().schedule.plan(stages);
    }

    /// Announces further stages, which come before those already announced.
    ///
    /// The bar goes on from where it is.
    pub fn plan_next(&self, stages: &[PlannedStage]) {
        self.lock().schedule.extend(stages);
    }

    /// Starts a new stage without progress.
    ///
    /// If it was announced, announced stages before it are left out; otherwise it is added.
    ///
    /// # Errors
    /// [`Stopped`] if a stop was requested.
    #[inline]
    pub fn stage(&self, name: &str) -> Result<(), Stopped> {
        let mut state = self.lock();
        state.schedule.begin(name, self.shared.begun.elapsed());
        let report = &mut state.report;
        report.stage.clear();
        report.stage.push_str(name);
        (report.done, report.total) = (0, 0);
        drop(state);
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
        let mut state = self.lock();
        (state.report.done, state.report.total) = (done, total);
        if total > 0 {
            let share = done as f64 / total as f64;
            let now = || self.shared.begun.elapsed();
            state.schedule.report(share, now);
        }
        drop(state);
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
        self.lock().report.clone()
    }

    /// Returns how far the job is over all its stages.
    #[must_use]
    pub fn overview(&self) -> Overview {
        let now = self.shared.begun.elapsed();
        let schedule = &mut self.lock().schedule;
        Overview {
            fraction: schedule.fraction(),
            left: schedule.left(now),
            steps: schedule.steps(),
        }
    }

    /// Returns how many stages have begun.
    #[must_use]
    pub fn stages_begun(&self) -> usize {
        self.lock().schedule.begun()
    }

    /// Returns the time that each step took so far, without the first `left_out` stages.
    ///
    /// Empty if no stages were announced.
    #[must_use]
    pub fn step_times(&self, left_out: usize) -> Vec<StepTime> {
        let now = self.shared.begun.elapsed();
        self.lock().schedule.step_times(left_out, now)
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, ReportState> {
        self.shared
            .state
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::super::StepState;
    use super::*;

    #[test]
    fn overview_covers_all_announced_stages() {
        let progress = Progress::default();
        assert_eq!(progress.overview(), Overview::default());
        progress.plan(&[
            PlannedStage::new("match", "Match images", 1.0),
            PlannedStage::new("map", "Compute cameras", 1.0),
        ]);
        progress.stage("match").unwrap();
        progress.step(1, 2).unwrap();
        progress.step(2, 2).unwrap();
        progress.stage("map").unwrap();
        let overview = progress.overview();
        assert_eq!(overview.fraction, Some(0.5));
        let states: Vec<_> = overview.steps.iter().map(|step| step.state).collect();
        assert_eq!(states, [StepState::Done, StepState::Running]);
        assert_eq!(overview.steps[1].title, "Compute cameras");
    }

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

use std::ops::ControlFlow;
use std::time::Duration;

use anyhow::Result;

use crate::jobs::{Job, JobKind};
use crate::{Event, JobCompletion, JobView, Session};
use ostra_compute::nn::take_fall_backs;
use ostra_core::job::JobId;
use ostra_frames::take_video_damage;
use ostra_project::OpenProject;

/// Interval at which [`Session::settle`] reports progress while nothing happens.
const GLANCE: Duration = Duration::from_millis(50);

impl Session {
    /// Applies the results of jobs since the last call and returns what happened.
    ///
    /// Never waits for a job.
    pub fn poll(&mut self) -> Vec<Event> {
        self.jobs.note_ended();
        self.warn_all(take_fall_backs());
        self.warn_all(take_video_damage());
        while let Some((job, completion)) = self.jobs.next_piece() {
            self.take_piece(job, completion);
        }
        while let Some((job, result)) = self.jobs.take_ended() {
            self.take_result(job, result);
        }
        self.record_progress();
        self.start_background_jobs();
        self.checkpoint_if_due();
        std::mem::take(&mut self.events)
    }

    /// Polls until no job runs, and returns all events, as the command line does.
    ///
    /// `on_progress` receives the running jobs about twenty times a second. `Break` stops them.
    pub fn settle(
        &mut self,
        mut on_progress: impl FnMut(&[JobView]) -> ControlFlow<()>,
    ) -> Vec<Event> {
        let mut events = self.poll();
        while self.jobs.iter().next().is_some() {
            if on_progress(&self.jobs()).is_break() {
                self.stop_all();
                // Save before the job notices the stop, because the process may be ended before
                // that.
                if let Err(error) = self.save_tracked(true) {
                    self.events.push(Event::Warning(format!("{error:#}")));
                }
            }
            if let Some((job, completion)) = self.jobs.wait(GLANCE) {
                self.take_piece(job, completion);
            }
            events.extend(self.poll());
        }
        events
    }

    /// Writes a checkpoint of the open project now, on this thread.
    ///
    /// `project.toml` and the masks are then up to date. Without it nothing is lost, because the
    /// journal holds every step.
    ///
    /// # Errors
    ///
    /// Returns an error if a file cannot be written.
    pub fn save(&mut self) -> Result<()> {
        self.wait_for_checkpoint();
        self.open.as_mut().map_or(Ok(()), OpenProject::save_now)
    }

    /// Waits until no checkpoint is being written, because two must not write the same files.
    pub(super) fn wait_for_checkpoint(&mut self) {
        let is_checkpoint = |job: &Job<Self>| job.kind == JobKind::Checkpoint && !job.has_ended();
        self.jobs.note_ended();
        while self.jobs.iter().any(is_checkpoint) {
            if let Some((job, completion)) = self.jobs.wait(GLANCE) {
                self.take_piece(job, completion);
            }
            self.jobs.note_ended();
        }
    }

    fn take_piece(&mut self, job: JobId, completion: JobCompletion) {
        let wanted = self.jobs.get_mut(job).is_some_and(|job| !job.discarded);
        if !wanted {
            return;
        }
        if let Err(error) = completion(self)
            && let Some(job) = self.jobs.get_mut(job)
        {
            job.stop();
            job.failure.get_or_insert(error);
        }
    }

    /// Applies the result of a job that ended. Results of discarded jobs are dropped.
    fn take_result(&mut self, mut job: Job<Self>, result: Result<JobCompletion>) {
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
            None => result.and_then(|completion| completion(self)),
        };
        self.end_record(&job, result.is_err() && stopped && !failed);
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
        match (job.kind.is_background(), event) {
            (true, Event::Failed { error, .. }) => self.events.push(Event::Warning(error)),
            (true, _) => {}
            (false, event) => self.events.push(event),
        }
    }

    fn checkpoint_if_due(&mut self) {
        let running = self.jobs.iter().any(|job| job.kind == JobKind::Checkpoint);
        let Some(open) = self.open.as_mut().filter(|open| open.is_due() && !running) else {
            return;
        };
        match open.checkpoint() {
            Ok(checkpoint) => {
                self.start("checkpoint", JobKind::Checkpoint, move |context| {
                    let written = checkpoint.write(&context.progress)?;
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
    /// Stops all jobs and writes a last checkpoint.
    ///
    /// If that fails, the journal still holds every step.
    fn drop(&mut self) {
        self.discard_jobs();
        if !std::thread::panicking() {
            let _ = self.save();
        }
    }
}

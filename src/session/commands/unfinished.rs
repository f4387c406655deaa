use crate::jobs::Job;
use crate::unfinished::{RunningRecord, Unfinished};
use crate::{Command, Event, Session};

impl Session {
    /// Returns work of the open project that was interrupted and can be continued.
    #[must_use]
    pub fn unfinished(&self) -> Option<&Unfinished> {
        self.unfinished.as_ref()
    }

    /// Removes the record of interrupted work. What the work has finished is kept.
    pub fn dismiss_unfinished(&mut self) {
        if self.unfinished.take().is_some() {
            self.remove_record();
        }
    }

    /// Reads the record of a project that was opened for changes.
    pub(crate) fn find_unfinished(&mut self) {
        self.running_record = None;
        let root = self.root().filter(|_| self.view_reason().is_none());
        self.unfinished = root.and_then(Unfinished::read);
    }

    /// Records a command whose work can be continued, when its job has started.
    ///
    /// Without the record the work goes on all the same.
    pub(crate) fn record_begun(&mut self, command: &Command) {
        if !matches!(command, Command::Reconstruct(_)) {
            return;
        }
        self.unfinished = None;
        let Some(root) = self.root() else { return };
        match RunningRecord::begin(root, command) {
            Ok(record) => self.running_record = Some(record),
            Err(error) => self.warn_not_recorded(&error),
        }
    }

    /// Adds to the record how far its job is.
    pub(crate) fn record_progress(&mut self) {
        let Some(record) = &mut self.running_record else {
            return;
        };
        let fraction = self
            .jobs
            .iter()
            .find(|job| record.is_of(job.command.as_ref()))
            .and_then(|job| job.view().overview.fraction);
        if let Err(error) = fraction.map_or(Ok(()), |fraction| record.note(fraction)) {
            self.running_record = None;
            self.warn_not_recorded(&error);
        }
    }

    /// Ends the record of a job: removes it, or offers to continue if the job was stopped.
    pub(crate) fn end_record(&mut self, job: &Job<Self>, was_stopped: bool) {
        let is_of = |record: &mut RunningRecord| record.is_of(job.command.as_ref());
        let Some(record) = self.running_record.take_if(is_of) else {
            return;
        };
        if was_stopped {
            self.unfinished = Some(record.into_unfinished(job.view().overview.fraction));
        } else {
            self.remove_record();
        }
    }

    fn remove_record(&mut self) {
        let removed = self.root().map_or(Ok(()), RunningRecord::remove);
        if let Err(error) = removed {
            self.events.push(Event::Warning(format!("{error:#}")));
        }
    }

    fn warn_not_recorded(&mut self, error: &anyhow::Error) {
        self.events.push(Event::Warning(format!(
            "{error:#}; if the program is interrupted, it cannot offer to continue"
        )));
    }
}

use anyhow::Result;

use crate::Session;
use ostra_project::OpenProject;

impl Session {
    pub(crate) fn undo(&mut self) -> Result<()> {
        self.stop_growing_run();
        self.opened()?.undo()?;
        self.tell_changed();
        Ok(())
    }

    pub(crate) fn redo(&mut self) -> Result<()> {
        self.opened()?.redo()?;
        self.tell_changed();
        Ok(())
    }

    /// A run whose step is taken back is stopped, and what it still brings is not taken in.
    fn stop_growing_run(&mut self) {
        let run = self.open.as_ref().and_then(OpenProject::growing_run);
        if let Some(job) = run.and_then(|run| self.jobs.get_mut(run)) {
            job.stop();
            job.discarded = true;
        }
    }
}

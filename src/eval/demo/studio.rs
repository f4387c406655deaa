use std::ops::ControlFlow;

use anyhow::{Result, anyhow};

use ostra_core::job::Stopped;
use ostra_session::{Command, Session};
use ostra_session::{Event, JobView};

/// Sees the running jobs about twenty times a second; `Break` stops the demo.
pub type Watch<'w> = dyn FnMut(&[JobView]) -> ControlFlow<()> + 'w;

/// A session at which commands are carried out one after another.
pub(super) struct Studio<'s, 'w> {
    pub session: &'s mut Session,
    watch: &'s mut Watch<'w>,
    /// What the session warned of.
    pub warnings: Vec<String>,
}

impl<'s, 'w> Studio<'s, 'w> {
    pub(super) fn new(session: &'s mut Session, watch: &'s mut Watch<'w>) -> Self {
        Self {
            session,
            watch,
            warnings: Vec::new(),
        }
    }

    /// Carries a command out to its end.
    pub(super) fn act(&mut self, command: Command) -> Result<()> {
        self.session.act(command)?;
        for event in self.session.settle(&mut *self.watch) {
            match event {
                Event::Failed { error, .. } => return Err(anyhow!(error)),
                Event::Stopped { .. } => return Err(Stopped.into()),
                Event::Warning(text) => self.warnings.push(text),
                _ => {}
            }
        }
        Ok(())
    }
}

use std::path::Path;
use std::sync::Arc;

use anyhow::Result;

use super::Session;
use super::jobs::{Kind, Landing};
use crate::Event;
use ostra_core::job::JobId;
use ostra_frames::{FilmOptions, Image, write_film};
use ostra_project::export_targets::ExportTargets;

impl Session {
    /// Refuses a file that an export must not replace: a source, a file inside a project, a file that OSTRA did not write.
    ///
    /// # Errors
    /// One line: which file, why, and what to do.
    pub fn check_export(&self, file: &Path, overwrite: bool) -> Result<()> {
        let project = self.project().map(Arc::clone).unwrap_or_default();
        ExportTargets::of(&project, self.root(), overwrite).check_files([file])
    }

    /// Writes an image by `write` on a worker thread.
    ///
    /// # Errors
    /// As [`Self::check_export`].
    pub fn write_picture(
        &mut self,
        path: &Path,
        overwrite: bool,
        write: impl FnOnce(&Path) -> Result<()> + Send + 'static,
    ) -> Result<JobId> {
        self.check_export(path, overwrite)?;
        let path = path.to_owned();
        Ok(self.start("Write picture", Kind::Short, move |link| {
            link.progress.stage("draw")?;
            ExportTargets::write_files(std::slice::from_ref(&path), || write(&path))?;
            Ok(Box::new(move |session: &mut Self| {
                session.events.push(Event::Notice(format!(
                    "picture written to {}",
                    path.display()
                )));
                Ok(())
            }) as Landing)
        }))
    }

    /// Writes a video whose images `draw` makes, by their number, on a worker thread.
    ///
    /// # Errors
    /// As [`Self::check_export`].
    pub fn write_film(
        &mut self,
        path: &Path,
        options: FilmOptions,
        overwrite: bool,
        draw: impl Fn(usize) -> Image + Send + 'static,
    ) -> Result<JobId> {
        self.check_export(path, overwrite)?;
        let path = path.to_owned();
        Ok(self.start("Write film", Kind::Short, move |link| {
            link.progress.stage("write film")?;
            let write = || Ok(write_film(&path, &options, draw, &link.progress)?);
            ExportTargets::write_files(std::slice::from_ref(&path), write)?;
            Ok(Box::new(move |session: &mut Self| {
                session
                    .events
                    .push(Event::Notice(format!("film written to {}", path.display())));
                Ok(())
            }) as Landing)
        }))
    }
}

use std::path::Path;

use anyhow::Result;

use super::jobs::{Kind, Landing};
use super::{Event, JobId, Session};
use crate::frames::{FilmOptions, Image, write_film};

impl Session {
    /// Writes a picture by `write` on a worker thread.
    pub fn write_picture(&mut self, path: &Path, write: impl FnOnce(&Path) -> Result<()> + Send + 'static) -> JobId {
        let path = path.to_owned();
        self.start("Write picture", Kind::Short, move |link| {
            link.progress.stage("draw")?;
            write(&path)?;
            Ok(Box::new(move |session: &mut Self| {
                session.events.push(Event::Notice(format!("picture written to {}", path.display())));
                Ok(())
            }) as Landing)
        })
    }

    /// Writes a film whose pictures `draw` makes, by their number, on a worker thread.
    pub fn write_film(
        &mut self,
        path: &Path,
        options: FilmOptions,
        draw: impl Fn(usize) -> Image + Send + 'static,
    ) -> JobId {
        let path = path.to_owned();
        self.start("Write film", Kind::Short, move |link| {
            link.progress.stage("write film")?;
            write_film(&path, &options, draw, &link.progress)?;
            Ok(Box::new(move |session: &mut Self| {
                session.events.push(Event::Notice(format!("film written to {}", path.display())));
                Ok(())
            }) as Landing)
        })
    }
}

use std::path::{Path, PathBuf, absolute};

use anyhow::{Context, Result, bail};

use crate::frames::{DepthSource, Frame, PictureSource};
use crate::session::jobs::Kind;
use crate::session::{Edit, JobId, Session};

impl Session {
    pub(in crate::session) fn relocate(&mut self, from: &Path, to: &Path) -> Result<JobId> {
        let project = self.snapshot()?;
        let from = absolute(from).with_context(|| format!("{}: is no path", from.display()))?;
        let to = absolute(to).with_context(|| format!("{}: is no path", to.display()))?;
        Ok(self.start("Look for moved frames", Kind::Short, move |link| {
            let mut edits = Vec::new();
            for (number, frame) in project.frames.iter().enumerate() {
                link.progress.step(number, project.frames.len())?;
                if let Some(value) = moved(frame, &from, &to)? {
                    edits.push(Edit::SetFrame { frame: number, value: Box::new(value) });
                }
            }
            if edits.is_empty() {
                bail!("no frame comes from {}; name the folder that 'info' or the message shows", from.display());
            }
            let title = format!("Frames moved to {}", to.display());
            Ok(Box::new(move |session: &mut Self| session.commit(&title, edits)))
        }))
    }
}

/// The frame with the sources that lay below `from` below `to`; `None` when none did.
fn moved(frame: &Frame, from: &Path, to: &Path) -> Result<Option<Frame>> {
    let mut value = frame.clone();
    let mut places: Vec<&mut PathBuf> = Vec::new();
    match &mut value.picture {
        PictureSource::File { path, .. } | PictureSource::Film { path, .. } => places.push(path),
    }
    if let Some(DepthSource::Sensor { path, .. }) = &mut value.depth {
        places.push(path);
    }
    let mut any = false;
    for place in places {
        let Ok(below) = place.strip_prefix(from) else { continue };
        let new = if below.as_os_str().is_empty() { to.to_owned() } else { to.join(below) };
        if !new.is_file() {
            bail!("{}: is missing; the frames cannot lie below {}", new.display(), to.display());
        }
        *place = new;
        any = true;
    }
    Ok(any.then_some(value))
}

use std::collections::BTreeSet;
use std::path::{Path, PathBuf, absolute};

use anyhow::{Context, Result, bail};

use crate::Event;
use crate::JobKind;
use crate::Session;
use ostra_core::job::JobId;
use ostra_frames::{Frame, check_source, sources, sources_mut};
use ostra_project::Edit;
use ostra_project::store::joined;

/// Maximum number of source folders that a message names.
const NAMED: usize = 3;

impl Session {
    pub(crate) fn relocate(&mut self, from: &Path, to: &Path) -> Result<JobId> {
        let project = self.snapshot()?;
        let (from, to) = (plain(from)?, plain(to)?);
        Ok(self.start("Locate frames", JobKind::Short, move |context| {
            let (mut edits, mut missing) = (Vec::new(), Vec::new());
            for (number, frame) in project.frames.iter().enumerate() {
                context.progress.step(number, project.frames.len())?;
                match moved(frame, &from, &to)? {
                    Moved::To(value) => edits.push(Edit::SetFrame { frame: number, value }),
                    Moved::Missing(path) => missing.push(path),
                    Moved::Not => {}
                }
            }
            let first_missing = missing.first().map(|path| path.display().to_string());
            if let Some(first) = first_missing.as_ref().filter(|_| edits.is_empty()) {
                bail!("{first}: is missing; give the folder that has the same files as {} had", from.display());
            }
            if edits.is_empty() {
                let folders = folders(&project.frames);
                bail!("no frame comes from {}; their sources are in {folders}: name one of these", from.display());
            }
            let (count, place) = (edits.len(), to.display().to_string());
            let warning = first_missing.map(|first| match missing.len() {
                1 => format!("1 frame stays as it was, because its file is not there: {first}"),
                count => format!(
                    "{count} frames stay as they were, because their files are not there (first: {first})"
                ),
            });
            Ok(Box::new(move |session: &mut Self| {
                session.commit(&format!("Frames moved to {place}"), edits)?;
                session.warn_all(warning.into_iter().collect());
                let read = if count == 1 { "1 frame is" } else { &format!("{count} frames are") };
                session.events.push(Event::Notice(format!("{read} read from {place} now")));
                Ok(())
            }))
        }))
    }
}

/// Returns the path as a project records it: absolute, without `..`.
fn plain(path: &Path) -> Result<PathBuf> {
    let absolute =
        absolute(path).with_context(|| format!("{}: cannot be a path", path.display()))?;
    Ok(joined(Path::new(""), &absolute))
}

/// Result of relocating a frame.
enum Moved {
    To(Box<Frame>),
    /// This file of the frame does not exist at the new place.
    Missing(PathBuf),
    /// None of the frame's sources was below the old place.
    Not,
}

/// Returns the frame with the sources that were below `from` moved to `to`.
///
/// Every new file must be one from which the frame can have been made.
fn moved(frame: &Frame, from: &Path, to: &Path) -> Result<Moved> {
    let place = |path: &Path| {
        let path = joined(Path::new(""), path);
        let below = path.strip_prefix(from).ok()?;
        Some(if below.as_os_str().is_empty() {
            to.to_owned()
        } else {
            to.join(below)
        })
    };
    let places: Vec<Option<PathBuf>> = sources(frame).map(place).collect();
    for (number, new) in places.iter().enumerate() {
        if let Some(new) = new {
            if !new.is_file() {
                return Ok(Moved::Missing(new.clone()));
            }
            check_source(frame, number, new)?;
        }
    }
    let mut value = frame.clone();
    for (path, new) in sources_mut(&mut value).zip(&places) {
        if let Some(new) = new {
            path.clone_from(new);
        }
    }
    Ok(if places.iter().any(Option::is_some) {
        Moved::To(Box::new(value))
    } else {
        Moved::Not
    })
}

/// Returns the first folders that frames are read from, as text.
fn folders(frames: &[Frame]) -> String {
    let all: BTreeSet<&Path> = frames
        .iter()
        .flat_map(sources)
        .filter_map(Path::parent)
        .collect();
    let named: Vec<String> = all
        .iter()
        .take(NAMED)
        .map(|folder| folder.display().to_string())
        .collect();
    let more = if all.len() > NAMED {
        format!(" and {} more folders", all.len() - NAMED)
    } else {
        String::new()
    };
    named.join(", ") + &more
}

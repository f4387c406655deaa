use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::durable;
use crate::engine::job::Progress;
use crate::frames::Frame;
use crate::masks::{LabelId, RunMask};
use crate::masks::{MaskFrame, encode_palette_png, file_stems, read_palette_png};
use crate::session::{FrameMask, MaskOrigin, Project};

/// What `masks/origins.json` says of one frame's mask, by the frame's name.
#[derive(Debug, Serialize, Deserialize)]
struct Origin {
    origin: MaskOrigin,
    #[serde(default)]
    stale: bool,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    confidence: BTreeMap<LabelId, f32>,
}

/// Where each frame's mask lies below the project's folder: `masks/`, the frame's name without its ending, `.png`.
///
/// # Errors
/// When a frame's name leads out of the folder.
pub fn paths(frames: &[Frame]) -> Result<Vec<PathBuf>> {
    let frames: Vec<MaskFrame<'_>> = frames.iter().map(MaskFrame::from).collect();
    let stems = file_stems(&frames)?;
    Ok(stems.into_iter().map(|stem| Path::new("masks").join(stem + ".png")).collect())
}

/// Writes the masks that differ from those written before, each by temporary name and rename.
///
/// # Errors
/// When one cannot be written, or on a stop.
pub fn write(root: &Path, project: &Project, before: &Runs, progress: &Progress) -> Result<()> {
    let unwritten = |(path, runs): &(PathBuf, Arc<RunMask>)| {
        before.get(path).is_none_or(|before| !Arc::ptr_eq(runs, before) && runs != before)
    };
    let changed: Vec<_> = runs(project)?.into_iter().filter(unwritten).collect();
    changed.par_iter().try_for_each(|(path, runs)| {
        progress.check()?;
        let bytes = encode_palette_png(runs, &project.labels)?;
        durable::replace(&root.join(path), &bytes)
    })
}

/// Masks by their path below the project's folder.
pub type Runs = BTreeMap<PathBuf, Arc<RunMask>>;

/// The masks of a project.
///
/// # Errors
/// As [`paths`].
pub fn runs(project: &Project) -> Result<Runs> {
    let paths = paths(&project.frames)?;
    Ok(project.masks.iter().map(|(&frame, mask)| (paths[frame].clone(), Arc::clone(&mask.runs))).collect())
}

/// What is known of the mask files when those of the frames `unread` were not read: these are taken for a mask
/// without pixels, which differs from every mask that may be written there.
///
/// # Errors
/// As [`paths`].
pub fn known(project: &Project, unread: &BTreeSet<usize>) -> Result<Runs> {
    let nothing = Arc::new(RunMask::empty(0, 0));
    let paths = paths(&project.frames)?;
    let unread = unread.iter().filter_map(|&frame| Some((paths.get(frame)?.clone(), Arc::clone(&nothing))));
    Ok(runs(project)?.into_iter().chain(unread).collect())
}

/// Writes `masks/origins.json`: where each mask comes from, whether it is stale, how sure the tracker was.
///
/// # Errors
/// When it cannot be written.
pub fn write_origins(root: &Path, project: &Project) -> Result<()> {
    let path = root.join("masks/origins.json");
    if project.masks.is_empty() && !path.exists() {
        return Ok(());
    }
    let origins: BTreeMap<&str, Origin> = project
        .masks
        .iter()
        .map(|(&frame, mask)| {
            let origin = Origin { origin: mask.origin, stale: mask.stale, confidence: mask.confidence.clone() };
            (project.frames[frame].name.as_str(), origin)
        })
        .collect();
    durable::replace(&path, &serde_json::to_vec_pretty(&origins)?)
}

/// Takes away the files of masks that were written before and are no more.
pub fn remove_gone(root: &Path, now: &Runs, before: &Runs) {
    for path in before.keys().filter(|path| !now.contains_key(*path)) {
        let _ = std::fs::remove_file(root.join(path));
    }
}

/// What [`read`] found.
#[derive(Default)]
pub struct ReadMasks {
    pub masks: BTreeMap<usize, FrameMask>,
    pub warnings: Vec<String>,
}

/// Reads the masks of the frames for which `wanted` holds. A mask whose file is gone is left out and named in the
/// warnings.
///
/// # Errors
/// When a file is damaged or of another size than its frame, or on a stop.
pub fn read(
    root: &Path,
    project: &Project,
    wanted: impl Fn(usize) -> bool + Sync,
    progress: &Progress,
) -> Result<ReadMasks> {
    let path = root.join("masks/origins.json");
    let text = match std::fs::read(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(ReadMasks::default()),
        Err(error) => return Err(error).with_context(|| format!("{}: cannot be read", path.display())),
    };
    let origins: BTreeMap<String, Origin> = serde_json::from_slice(&text)
        .with_context(|| format!("{}: is damaged; restore it from a backup", path.display()))?;
    let paths = paths(&project.frames)?;
    let listed: Vec<_> = project.frames.iter().enumerate().filter(|(number, _)| wanted(*number)).collect();
    let read = listed.par_iter().filter_map(|&(number, frame)| {
        let origin = origins.get(&frame.name)?;
        Some(read_one(root, &paths[number], origin, progress).map(|mask| (number, mask)))
    });
    let mut found = ReadMasks::default();
    for (number, mask) in read.collect::<Result<Vec<_>>>()? {
        match mask {
            Some(mask) => drop(found.masks.insert(number, mask)),
            None => {
                found.warnings.push(format!("{}: is gone; frame {number} has no mask now", paths[number].display()));
            }
        }
    }
    Ok(found)
}

fn read_one(root: &Path, path: &Path, origin: &Origin, progress: &Progress) -> Result<Option<FrameMask>> {
    progress.check()?;
    let path = root.join(path);
    if !path.exists() {
        return Ok(None);
    }
    let mask = read_palette_png(&path).context("restore the mask, or remove it to go on without")?;
    let runs = Arc::new(RunMask::encode(&mask));
    Ok(Some(FrameMask { runs, origin: origin.origin, stale: origin.stale, confidence: origin.confidence.clone() }))
}

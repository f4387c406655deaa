use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{durable, mask_png};
use crate::engine::job::Progress;
use crate::frames::Frame;
use crate::masks::{LabelId, RunMask};
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

/// Where each frame's mask lies below the project's folder: `masks/` and the frame's name with `.png` in the place of
/// its ending; with `.png` after it where an earlier frame has that place already.
pub fn paths(frames: &[Frame]) -> Vec<PathBuf> {
    let mut taken = BTreeSet::new();
    let place = |frame: &Frame| {
        let name = Path::new(&frame.name);
        let stem = name.file_stem().map(|stem| name.with_file_name(stem)).unwrap_or_default();
        let mut path = with_png(&stem);
        if !taken.insert(path.clone()) {
            path = with_png(name);
            taken.insert(path.clone());
        }
        Path::new("masks").join(path)
    };
    frames.iter().map(place).collect()
}

fn with_png(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".png");
    PathBuf::from(name)
}

/// Writes the masks that differ from those written before, each by temporary name and rename.
///
/// # Errors
/// When one cannot be written, or on a stop.
pub fn write(root: &Path, project: &Project, before: &Runs, progress: &Progress) -> Result<()> {
    let unwritten = |(path, runs): &(PathBuf, Arc<RunMask>)| {
        before.get(path).is_none_or(|before| !Arc::ptr_eq(runs, before) && runs != before)
    };
    let changed: Vec<_> = runs(project).into_iter().filter(unwritten).collect();
    changed.par_iter().try_for_each(|(path, runs)| {
        progress.check()?;
        let bytes = mask_png::encode(&runs.decode(), &project.labels)?;
        durable::replace(&root.join(path), &bytes)
    })
}

/// Masks by their path below the project's folder.
pub type Runs = BTreeMap<PathBuf, Arc<RunMask>>;

/// The masks of a project.
pub fn runs(project: &Project) -> Runs {
    let paths = paths(&project.frames);
    project.masks.iter().map(|(&frame, mask)| (paths[frame].clone(), Arc::clone(&mask.runs))).collect()
}

/// What is known of the mask files when those of the frames `unread` were not read: these are taken for a mask
/// without pixels, which differs from every mask that may be written there.
pub fn known(project: &Project, unread: &BTreeSet<usize>) -> Runs {
    let nothing = Arc::new(RunMask { width: 0, height: 0, runs: Vec::new() });
    let paths = paths(&project.frames);
    let unread = unread.iter().filter_map(|&frame| Some((paths.get(frame)?.clone(), Arc::clone(&nothing))));
    runs(project).into_iter().chain(unread).collect()
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
    let paths = paths(&project.frames);
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
    let bytes = match std::fs::read(&path) {
        Ok(bytes) => bytes,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(error).with_context(|| format!("{}: cannot be read", path.display())),
    };
    let mask = mask_png::decode(&bytes)
        .with_context(|| format!("{}: is damaged; restore it, or remove it to go on without", path.display()))?;
    let runs = Arc::new(RunMask::encode(&mask));
    Ok(Some(FrameMask { runs, origin: origin.origin, stale: origin.stale, confidence: origin.confidence.clone() }))
}

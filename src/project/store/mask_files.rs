use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Result;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::damage::Damage;
use super::durable;
use crate::{FrameMask, MaskOrigin, Project};
use ostra_core::disk;
use ostra_core::job::Progress;
use ostra_frames::Frame;
use ostra_masks::{LabelId, RunMask};
use ostra_masks::{MaskFrame, encode_palette_png, file_stems, read_palette_png_of};

/// Maximum size of the list of origins; a larger one is damaged.
///
/// A list of one million masks takes half of it.
const MAX_ORIGINS_BYTES: u64 = 256 << 20;

/// File with the origins of the masks, relative to the project's folder.
const ORIGINS: &str = "masks/origins.json";

/// Entry of a frame's mask in `masks/origins.json`, stored under the frame's name.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct OriginEntry {
    origin: MaskOrigin,
    #[serde(default)]
    stale: bool,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    confidence: BTreeMap<LabelId, f32>,
}

/// Returns the path of each frame's mask, relative to the project's folder.
///
/// It is `masks/`, the frame's name without its extension, and `.png`.
///
/// # Errors
///
/// Returns an error if a frame's name leads out of the folder.
pub fn paths(frames: &[Frame]) -> Result<Vec<PathBuf>> {
    let frames: Vec<MaskFrame<'_>> = frames.iter().map(MaskFrame::from).collect();
    let stems = file_stems(&frames)?;
    Ok(stems
        .into_iter()
        .map(|stem| Path::new("masks").join(stem + ".png"))
        .collect())
}

/// Writes the masks that differ from those written before, each atomically.
///
/// # Errors
///
/// Returns an error if a mask cannot be written, or the progress is stopped.
pub fn write(root: &Path, project: &Project, before: &Runs, progress: &Progress) -> Result<()> {
    let unwritten = |(path, runs): &(PathBuf, Arc<RunMask>)| {
        before
            .get(path)
            .is_none_or(|before| !Arc::ptr_eq(runs, before) && runs != before)
    };
    let changed: Vec<_> = runs(project)?.into_iter().filter(unwritten).collect();
    changed.par_iter().try_for_each(|(path, runs)| {
        progress.check()?;
        let bytes = encode_palette_png(runs, &project.labels)?;
        durable::replace(&root.join(path), &bytes)
    })
}

/// Masks by their path relative to the project's folder.
pub type Runs = BTreeMap<PathBuf, Arc<RunMask>>;

/// Returns the masks of a project by path.
///
/// # Errors
///
/// Returns the errors of [`paths`].
pub fn runs(project: &Project) -> Result<Runs> {
    let paths = paths(&project.frames)?;
    Ok(project
        .masks
        .iter()
        .map(|(&frame, mask)| (paths[frame].clone(), Arc::clone(&mask.runs)))
        .collect())
}

/// Returns the known content of the mask files if those of the frames `unread` were not read.
///
/// The unread files are represented by a mask without pixels, which differs from every mask that
/// may be written there.
///
/// # Errors
///
/// Returns the errors of [`paths`].
pub fn known(project: &Project, unread: &BTreeSet<usize>) -> Result<Runs> {
    let nothing = Arc::new(RunMask::empty(0, 0));
    let paths = paths(&project.frames)?;
    let unread = unread
        .iter()
        .filter_map(|&frame| Some((paths.get(frame)?.clone(), Arc::clone(&nothing))));
    Ok(runs(project)?.into_iter().chain(unread).collect())
}

/// Writes `masks/origins.json`: origin, stale flag and tracker confidence of each mask.
///
/// # Errors
///
/// Returns an error if it cannot be written.
pub fn write_origins(root: &Path, project: &Project) -> Result<()> {
    let path = root.join(ORIGINS);
    if project.masks.is_empty() && !path.exists() {
        return Ok(());
    }
    let origins: BTreeMap<&str, OriginEntry> = project
        .masks
        .iter()
        .map(|(&frame, mask)| {
            let origin = OriginEntry {
                origin: mask.origin,
                stale: mask.stale,
                confidence: mask.confidence.clone(),
            };
            (project.frames[frame].name.as_str(), origin)
        })
        .collect();
    durable::replace(&path, &serde_json::to_vec_pretty(&origins)?)
}

/// Removes the files of masks that were written before and no longer exist.
pub fn remove_gone(root: &Path, now: &Runs, before: &Runs) {
    for path in before.keys().filter(|path| !now.contains_key(*path)) {
        let _ = std::fs::remove_file(root.join(path));
    }
}

/// Result of [`read`].
#[derive(Debug, Default)]
pub struct ReadMasks {
    pub masks: BTreeMap<usize, FrameMask>,
    pub warnings: Vec<String>,
    pub damages: Vec<Damage>,
}

/// Reads the masks of the frames for which `wanted` returns true.
///
/// Every returned mask fits the project. Missing or damaged masks are left out. If `origins.json`
/// or an entry in it cannot be read, the affected masks count as keyframes, which no tracker
/// overwrites.
///
/// # Errors
///
/// Returns an error if a frame's name leads out of the folder, or the progress is stopped.
pub fn read(
    root: &Path,
    project: &Project,
    wanted: impl Fn(usize) -> bool + Sync,
    progress: &Progress,
) -> Result<ReadMasks> {
    let mut found = ReadMasks::default();
    let paths = paths(&project.frames)?;
    let origins = Origins::read(&root.join(ORIGINS));
    let listed: Vec<_> = project
        .frames
        .iter()
        .enumerate()
        .filter(|(number, _)| wanted(*number))
        .collect();
    let read = listed.par_iter().filter_map(|&(number, frame)| {
        let path = root.join(&paths[number]);
        let origin = match origins.of(&frame.name) {
            StoredMask::As(origin) => origin,
            StoredMask::Nothing => return None,
            StoredMask::Damaged if path.exists() => OriginEntry::keyframe(),
            StoredMask::Damaged => return None,
        };
        let mask = progress
            .check()
            .map_err(anyhow::Error::from)
            .map(|()| read_one(&path, project, number, origin));
        Some(mask.map(|mask| (number, mask)))
    });
    let mut masks_there = 0;
    for (number, mask) in read.collect::<Result<Vec<_>>>()? {
        let name = &project.frames[number].name;
        match mask {
            LoadedMask::Whole(mask) => {
                masks_there += 1;
                found.masks.insert(number, mask);
            }
            LoadedMask::Gone => {
                found.warnings.push(format!(
                    "{}: is gone; frame {number} has no mask now",
                    paths[number].display()
                ));
            }
            LoadedMask::Damaged(why) => found.damages.push(Damage {
                path: root.join(&paths[number]),
                what: format!("{why}; frame {number} ({name}) has no mask now"),
                is_in_use: false,
            }),
        }
    }
    origins.report(root, masks_there, &mut found);
    Ok(found)
}

/// Content of `origins.json`.
enum Origins {
    /// Entries by frame name; `None` for a damaged entry.
    Read(BTreeMap<String, Option<OriginEntry>>),
    Missing,
    /// Why the file cannot be used.
    Damaged(String),
}

/// What is known about one frame's mask.
enum StoredMask {
    As(OriginEntry),
    /// The frame has no mask.
    Nothing,
    /// The frame has a mask if its file exists.
    Damaged,
}

impl Origins {
    fn read(path: &Path) -> Self {
        let text = match disk::read_regular_up_to(path, MAX_ORIGINS_BYTES) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Self::Missing,
            Err(error) => return Self::Damaged(format!("cannot be read ({error})")),
        };
        match serde_json::from_slice::<BTreeMap<String, serde_json::Value>>(&text) {
            Ok(entries) => {
                let entry = |value| {
                    serde_json::from_value(value)
                        .ok()
                        .filter(OriginEntry::is_sound)
                };
                Self::Read(
                    entries
                        .into_iter()
                        .map(|(name, value)| (name, entry(value)))
                        .collect(),
                )
            }
            Err(error) => Self::Damaged(format!("is damaged ({error})")),
        }
    }

    fn of(&self, frame: &str) -> StoredMask {
        match self {
            Self::Read(entries) => match entries.get(frame) {
                Some(Some(origin)) => StoredMask::As(origin.clone()),
                Some(None) => StoredMask::Damaged,
                None => StoredMask::Nothing,
            },
            Self::Missing | Self::Damaged(_) => StoredMask::Damaged,
        }
    }

    /// Adds warnings and damage about the file itself.
    fn report(self, root: &Path, masks: usize, found: &mut ReadMasks) {
        let path = root.join(ORIGINS);
        let keyframes = |count: usize| {
            format!(
                "it is not known which masks are keyframes; all {count} masks count as keyframes now"
            )
        };
        let damage = |what: String| Damage {
            path: path.clone(),
            what,
            is_in_use: false,
        };
        match self {
            Self::Missing if masks > 0 => {
                found.warnings.push(format!(
                    "{}: is missing; {}",
                    path.display(),
                    keyframes(masks)
                ));
            }
            Self::Missing => {}
            Self::Damaged(why) => found
                .damages
                .push(damage(format!("{why}; {}", keyframes(masks)))),
            Self::Read(entries) => {
                let damaged = entries.values().filter(|entry| entry.is_none()).count();
                if damaged > 0 {
                    let what = format!(
                        "{damaged} of its entries are damaged; {}",
                        keyframes(damaged)
                    );
                    found.damages.push(damage(what));
                }
            }
        }
    }
}

impl OriginEntry {
    fn keyframe() -> Self {
        Self {
            origin: MaskOrigin::Keyframe,
            stale: false,
            confidence: BTreeMap::new(),
        }
    }

    /// Returns whether a mask can have this origin.
    fn is_sound(&self) -> bool {
        let shares = self
            .confidence
            .values()
            .all(|share| (0.0..=1.0).contains(share));
        shares && !(self.stale && self.origin == MaskOrigin::Keyframe)
    }
}

enum LoadedMask {
    Whole(FrameMask),
    Gone,
    /// Why the mask cannot be used.
    Damaged(String),
}

fn read_one(path: &Path, project: &Project, frame: usize, origin: OriginEntry) -> LoadedMask {
    if !path.exists() {
        return LoadedMask::Gone;
    }
    let shown = &project.frames[frame];
    let mask = match read_palette_png_of(path, &MaskFrame::from(shown)) {
        Ok(mask) => mask,
        Err(error) => {
            return LoadedMask::Damaged(format!("cannot be read ({})", without_path(&error, path)));
        }
    };
    let OriginEntry {
        origin,
        stale,
        confidence,
    } = origin;
    let mask = FrameMask {
        runs: Arc::new(RunMask::encode(&mask)),
        origin,
        stale,
        confidence,
    };
    match project.check_mask(shown, &mask) {
        Ok(()) => LoadedMask::Whole(mask),
        Err(error) => LoadedMask::Damaged(format!("does not fit the project ({error:#})")),
    }
}

/// Returns an error's text without the leading file path.
fn without_path(error: &dyn std::fmt::Display, path: &Path) -> String {
    let text = error.to_string().replace('\n', " ");
    let shown = format!("{}: ", path.display());
    text.strip_prefix(&shown)
        .map_or(text.clone(), str::to_owned)
}

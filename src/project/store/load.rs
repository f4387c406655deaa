use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result};

use super::damage::Damage;
use super::history_file::{self, Past};
use super::journal::{ReadRecords, read_records};
use super::manifest::{self, Manifest};
use super::mask_files::{self, ReadMasks, Runs};
use super::{Act, JournalRecord, contained, source_paths};
use crate::{Edit, History, Project};
use ostra_core::job::Progress;
use ostra_frames::Frame;

/// The content of a project's files. Reading them changes nothing.
pub struct StoredState {
    pub project: Project,
    /// Steps that lead to this state.
    pub history: History,
    /// Number of the last record in `project.toml`.
    pub checkpoint: u64,
    /// Number of the last record overall.
    pub seq: u64,
    /// Records of the journal that are applied to the project.
    pub journal: ReadRecords,
    /// Known content of the mask files.
    pub masks: Runs,
    /// Number of the last record in `history.jsonl`, and the end of its line in bytes.
    pub history_end: (u64, u64),
    /// Files that cannot be used as they are.
    pub damages: Vec<Damage>,
    /// Other warnings for the user.
    pub warnings: Vec<String>,
}

/// Reads the checkpoint and the later records of the journal.
///
/// Steps from the first record that is damaged or does not follow are left out.
///
/// A kill during a checkpoint may leave mask files that are newer than `project.toml`. Each such
/// mask was set by a record that the journal still holds. The mask files of frames that the journal
/// sets are therefore not read.
///
/// # Errors
///
/// Returns an error if `project.toml` or the journal cannot be read, they do not belong together,
/// or the progress is stopped.
pub fn state(root: &Path, progress: &Progress) -> Result<StoredState> {
    let manifest = manifest::read(root)?;
    let (checkpoint, former) = (manifest.step, manifest.folder.clone());
    let path = root.join("journal.jsonl");
    let mut journal = read_records(&path)?;
    let base = base(root, manifest)?;
    cut_at_gap(&mut journal, checkpoint);
    let (mut project, read, masks) = loop {
        let (project, read, masks) =
            with_masks(root, base.clone(), later(&journal, checkpoint), progress)?;
        match replayed(&project, later(&journal, checkpoint)) {
            Ok(project) => break (project, read, masks),
            Err((place, error)) => {
                let first = journal.records.len() - later(&journal, checkpoint).len() + place;
                let why = format!("line {} does not fit the project ({error:#})", first + 1);
                journal.cut(first, why.replace('\n', " "));
            }
        }
    };
    let seq = journal
        .records
        .last()
        .map_or(checkpoint, |record| record.seq.max(checkpoint));
    let Past {
        mut history,
        seq: history_seq,
        length,
        damage,
        warning,
    } = history_file::read(root, checkpoint, &journal.records);
    for record in journal
        .records
        .iter()
        .filter(|record| record.seq > history_seq)
    {
        record.clone().fold(&mut history);
    }
    let ReadMasks {
        mut warnings,
        mut damages,
        ..
    } = read;
    damages.extend(journal_damage(&path, &journal));
    damages.extend(damage);
    warnings.extend(warning);
    warnings.extend(journal.is_torn.then(|| torn(&path)));
    warnings.extend(source_paths::find_moved(
        &mut project,
        former.as_deref(),
        root,
    ));
    let history_end = (history_seq, length);
    Ok(StoredState {
        project,
        history,
        checkpoint,
        seq,
        journal,
        masks,
        history_end,
        damages,
        warnings,
    })
}

/// Reads the frames of a project as of its last checkpoint, to show what the folder holds.
///
/// Nothing is written, and no lock is taken.
///
/// # Errors
///
/// Returns an error if the folder holds no project that this program can read.
pub fn read_frames(root: &Path) -> Result<Arc<Vec<Frame>>> {
    manifest::check_format(root)?;
    contained::check(root)?;
    let manifest = manifest::read(root)?;
    let former = manifest.folder.clone();
    let mut project = base(root, manifest)?;
    source_paths::find_moved(&mut project, former.as_deref(), root);
    Ok(project.frames)
}

/// Returns the project of `project.toml`, without masks.
fn base(root: &Path, manifest: Manifest) -> Result<Project> {
    let damaged = || {
        format!(
            "{}: is damaged; restore it from a backup",
            root.join("project.toml").display()
        )
    };
    manifest.into_project(root).with_context(damaged)
}

/// Returns the records that `project.toml` does not contain.
fn later(journal: &ReadRecords, checkpoint: u64) -> &[JournalRecord] {
    let first = journal
        .records
        .iter()
        .take_while(|record| record.seq <= checkpoint)
        .count();
    &journal.records[first..]
}

/// Drops the records after a missing step.
///
/// If the first step after those of `project.toml` is missing, the two files are from different
/// times.
fn cut_at_gap(journal: &mut ReadRecords, checkpoint: u64) {
    let after = later(journal, checkpoint);
    let numbers = after.iter().map(|record| record.seq);
    let gap = numbers
        .zip(checkpoint + 1..)
        .position(|(found, expected)| found != expected);
    if let Some(place) = gap {
        let first = journal.records.len() - after.len() + place;
        let why = format!("lacks step {}", checkpoint + 1 + place as u64);
        journal.cut(first, why);
    }
}

fn with_masks(
    root: &Path,
    mut project: Project,
    later: &[JournalRecord],
    progress: &Progress,
) -> Result<(Project, ReadMasks, Runs)> {
    let set_later: BTreeSet<usize> = later
        .iter()
        .flat_map(|record| masks_set(&record.act))
        .collect();
    let mut read = mask_files::read(
        root,
        &project,
        |frame| !set_later.contains(&frame),
        progress,
    )?;
    for (frame, mask) in std::mem::take(&mut read.masks) {
        project.apply(Edit::SetMask {
            frame,
            mask: Some(mask),
        })?;
    }
    let known = mask_files::known(&project, &set_later)?;
    Ok((project, read, known))
}

/// Returns the project after the records, or the index of the record that does not fit.
fn replayed(base: &Project, records: &[JournalRecord]) -> Result<Project, (usize, anyhow::Error)> {
    let mut project = base.clone();
    for (place, record) in records.iter().enumerate() {
        record
            .replay(&mut project)
            .map_err(|error| (place, error))?;
    }
    Ok(project)
}

fn journal_damage(path: &Path, journal: &ReadRecords) -> Option<Damage> {
    let rest = journal.rest.as_ref()?;
    let lost = match rest.after {
        0 => "this step is left out".to_owned(),
        1 => "this step and the one after it are left out".to_owned(),
        after => format!("this step and the {after} after it are left out"),
    };
    Some(Damage {
        path: path.to_owned(),
        what: format!("{}; {lost}", rest.why),
        is_in_use: true,
    })
}

fn torn(path: &Path) -> String {
    format!(
        "{}: its last line is incomplete (the program ended while it was written); that step is left out",
        path.display()
    )
}

fn masks_set(act: &Act) -> Vec<usize> {
    let set = |edit: &Edit| match edit {
        Edit::SetMask { frame, .. } => Some(*frame),
        _ => None,
    };
    match act {
        Act::Step { changes, .. } => changes
            .iter()
            .filter_map(|change| set(&change.edit))
            .collect(),
        Act::Undo { edits } | Act::Redo { edits } => edits.iter().filter_map(set).collect(),
    }
}

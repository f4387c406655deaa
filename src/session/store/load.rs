use std::collections::BTreeSet;
use std::path::Path;

use anyhow::{Context, Result, ensure};

use super::manifest::Manifest;
use super::mask_files::{self, Runs};
use super::{Act, Record};
use crate::engine::job::Progress;
use crate::session::{Edit, Project};

/// The state that a folder's files hold.
pub struct State {
    pub project: Project,
    /// What is known of the mask files.
    pub masks: Runs,
    pub warnings: Vec<String>,
}

/// The checkpoint with the journal's later records done to it.
///
/// A kill during a checkpoint may leave mask files that are ahead of `project.toml`; every mask that is ahead was set
/// by a record that the journal still holds, so the files of the frames that it sets are not read.
pub fn state(root: &Path, manifest: Manifest, records: &[Record], progress: &Progress) -> Result<State> {
    let damaged = || format!("{}: is damaged; restore it from a backup", root.join("project.toml").display());
    let checkpoint = manifest.step;
    let mut project = manifest.into_project().with_context(damaged)?;
    let later: Vec<&Record> = records.iter().filter(|record| record.seq > checkpoint).collect();
    let set_later: BTreeSet<usize> = later.iter().flat_map(|record| masks_set(&record.act)).collect();
    let read = mask_files::read(root, &project, |frame| !set_later.contains(&frame), progress)?;
    for (frame, mask) in read.masks {
        project.apply(Edit::SetMask { frame, mask: Some(mask) })?;
    }
    let masks = mask_files::known(&project, &set_later)?;
    for (record, number) in later.into_iter().zip(checkpoint + 1..) {
        let fits = || format!("{}: does not belong to this project.toml", root.join("journal.jsonl").display());
        ensure!(record.seq == number, "{}; restore both from one backup", fits());
        record.replay(&mut project).with_context(fits)?;
    }
    Ok(State { project, masks, warnings: read.warnings })
}

fn masks_set(act: &Act) -> Vec<usize> {
    let set = |edit: &Edit| match edit {
        Edit::SetMask { frame, .. } => Some(*frame),
        _ => None,
    };
    match act {
        Act::Step { changes, .. } => changes.iter().filter_map(|change| set(&change.edit)).collect(),
        Act::Undo { edits } | Act::Redo { edits } => edits.iter().filter_map(set).collect(),
    }
}

use std::io::{Seek, SeekFrom, Write};
use std::path::Path;

use anyhow::{Context, Result};

use super::damage::Damage;
use super::journal::read_records;
use super::{Act, JournalRecord, durable};
use crate::{History, Step};
use ostra_core::disk;

/// Content of `history.jsonl`.
#[derive(Debug, Default)]
pub struct Past {
    pub history: History,
    /// Number of the last record in it.
    pub seq: u64,
    /// Bytes of complete lines.
    pub length: u64,
    /// Damage of the file, if it exists and cannot be used.
    pub damage: Option<Damage>,
    /// Warning for the user if the file is missing.
    pub warning: Option<String>,
}

/// Reads the history that belongs to a checkpoint and the journal's records.
///
/// The history is optional and never prevents a project from being opened. If it is damaged or has
/// a gap before the journal, it starts again from there. Steps that the project lacks because the
/// journal is damaged are left out.
pub fn read(root: &Path, checkpoint: u64, journal: &[JournalRecord]) -> Past {
    let path = root.join("history.jsonl");
    // The journal may hold only part of the steps before the checkpoint.
    let none = Past {
        seq: checkpoint,
        ..Past::default()
    };
    let lost = "steps made before cannot be undone";
    let damaged = |why: String| Damage {
        path: path.clone(),
        what: format!("{why}; {lost}"),
        is_in_use: false,
    };
    let read = match read_records(&path) {
        Ok(read) => read,
        Err(_) => {
            return Past {
                damage: Some(damaged("cannot be read".into())),
                ..none
            };
        }
    };
    if let Some(rest) = read.rest {
        return Past {
            damage: Some(damaged(rest.why)),
            ..none
        };
    }
    if let Some(pair) = read
        .records
        .windows(2)
        .find(|pair| pair[1].seq != pair[0].seq + 1)
    {
        return Past {
            damage: Some(damaged(format!("lacks step {}", pair[0].seq + 1))),
            ..none
        };
    }
    let last = journal
        .last()
        .map_or(checkpoint, |record| record.seq.max(checkpoint));
    let kept: Vec<(JournalRecord, u64)> = read
        .records
        .into_iter()
        .zip(read.ends)
        .take_while(|(record, _)| record.seq <= last)
        .collect();
    let seq = kept.last().map_or(0, |(record, _)| record.seq);
    let joins = seq >= checkpoint || journal.iter().any(|record| record.seq == seq + 1);
    if !joins {
        let is_there = std::fs::metadata(&path).is_ok_and(|found| found.len() > 0);
        let damage =
            is_there.then(|| damaged(format!("lacks the steps from {} to {checkpoint}", seq + 1)));
        let warning = (!is_there).then(|| format!("{}: is missing; {lost}", path.display()));
        return Past {
            damage,
            warning,
            ..none
        };
    }
    let mut past = Past {
        seq,
        length: kept.last().map_or(0, |(_, end)| *end),
        ..Past::default()
    };
    kept.into_iter()
        .for_each(|(record, _)| record.fold(&mut past.history));
    past
}

/// Appends lines after the first `length` bytes of `history.jsonl` and syncs the file.
///
/// Returns the new length.
///
/// # Errors
///
/// Returns an error if the file cannot be written. Its first `length` bytes stay unchanged.
pub fn append(root: &Path, length: u64, lines: &[u8]) -> Result<u64> {
    let path = root.join("history.jsonl");
    let write = || -> std::io::Result<()> {
        let mut file = disk::open_in_place(&path)?;
        file.set_len(length)?;
        file.seek(SeekFrom::Start(length))?;
        file.write_all(lines)?;
        file.sync_all()
    };
    write().with_context(|| durable::cannot_write(&path))?;
    Ok(length + lines.len() as u64)
}

/// Rewrites the file with the steps of `history`, whose last record is `seq`.
///
/// Returns the length of the file.
///
/// # Errors
///
/// Returns an error if it cannot be written. The old file is then kept.
pub fn rewrite(root: &Path, history: &History, seq: u64) -> Result<u64> {
    let (steps, undone) = history.steps();
    let steps: Vec<_> = steps.collect();
    // Steps keep their order and precede the undos. The numbers only have to increase and end with
    // `seq`.
    let first = (seq + 1).saturating_sub((steps.len() + undone) as u64);
    let made = steps.iter().map(|step| {
        let Step { title, changes } = step.as_ref();
        Act::Step {
            title: title.clone(),
            changes: changes.clone(),
            continues: false,
        }
    });
    let taken_back = std::iter::repeat_n(Act::Undo { edits: Vec::new() }, undone);
    let mut lines = Vec::new();
    for (act, number) in made.chain(taken_back).zip(first..) {
        lines.extend(JournalRecord { seq: number, act }.line()?);
    }
    durable::replace(&root.join("history.jsonl"), &lines)?;
    Ok(lines.len() as u64)
}

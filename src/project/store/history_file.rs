use std::io::{Seek, SeekFrom, Write};
use std::path::Path;

use anyhow::{Context, Result};

use super::damage::Damage;
use super::journal::read_records;
use super::{Act, Record, durable};
use crate::{History, Step};
use ostra_core::disk;

/// What `history.jsonl` holds.
#[derive(Debug, Default)]
pub struct Past {
    pub history: History,
    /// Number of the last record in it.
    pub seq: u64,
    /// Bytes of whole lines.
    pub length: u64,
    /// What is wrong with the file, where it is there and cannot be used.
    pub damage: Option<Damage>,
    /// What the user should know where nothing of it is left on the disk.
    pub warning: Option<String>,
}

/// Reads the history that belongs to a checkpoint and the journal's records. It is a convenience, never a reason not
/// to open a project: where it is damaged or leaves a gap before the journal, it starts again from there. Steps that the
/// project does not have because the journal is damaged are left out.
pub fn read(root: &Path, checkpoint: u64, journal: &[Record]) -> Past {
    let path = root.join("history.jsonl");
    // What the journal still has of the steps before the checkpoint is not the whole of them.
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
    let kept: Vec<(Record, u64)> = read
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

/// Appends whole lines after the first `length` bytes of `history.jsonl` and waits until they are on the disk.
///
/// # Errors
/// When the file cannot be written; its first `length` bytes stand.
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

/// Writes the file again with the steps of `history`, the last of whose records is `seq`; returns its length.
///
/// # Errors
/// When it cannot be written; the old file stands.
pub fn rewrite(root: &Path, history: &History, seq: u64) -> Result<u64> {
    let (steps, undone) = history.steps();
    let steps: Vec<_> = steps.collect();
    // Steps keep their order and come before the undos; the numbers only have to rise and end with `seq`.
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
        lines.extend(Record { seq: number, act }.line()?);
    }
    durable::replace(&root.join("history.jsonl"), &lines)?;
    Ok(lines.len() as u64)
}

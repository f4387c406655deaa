use std::fs::OpenOptions;
use std::io::{Seek, SeekFrom, Write};
use std::path::Path;

use anyhow::{Context, Result};

use super::journal::read_records;
use super::{Act, Record, durable};
use crate::session::{History, Step};

/// What `history.jsonl` holds.
#[derive(Default)]
pub struct Past {
    pub history: History,
    /// Number of the last record in it.
    pub seq: u64,
    /// Bytes of whole lines.
    pub length: u64,
}

/// Reads the history that belongs to a checkpoint and the journal's records. It is a convenience, never a reason not
/// to open a project: where it is damaged or leaves a gap before the journal, the user is told and it begins anew.
pub fn read(root: &Path, checkpoint: u64, journal: &[Record], warnings: &mut Vec<String>) -> Past {
    let path = root.join("history.jsonl");
    let mut past = Past::default();
    let mut told = false;
    match read_records(&path) {
        Ok(read) => {
            past.length = read.ends.last().copied().unwrap_or(0);
            past.seq = read.records.last().map_or(0, |record| record.seq);
            read.records.into_iter().for_each(|record| record.fold(&mut past.history));
        }
        Err(error) => {
            warnings.push(format!("{error}; steps made before cannot be undone"));
            told = true;
        }
    }
    let joins = past.seq >= checkpoint || journal.iter().any(|record| record.seq == past.seq + 1);
    if !joins {
        if !told {
            warnings.push(format!("{}: is not complete; steps made before cannot be undone", path.display()));
        }
        // What the journal still has of the steps before the checkpoint is not the whole of them.
        return Past { seq: checkpoint, ..Past::default() };
    }
    past
}

/// Appends whole lines after the first `length` bytes of `history.jsonl` and waits until they are on the disk.
///
/// # Errors
/// When the file cannot be written; its first `length` bytes stand.
pub fn append(root: &Path, length: u64, lines: &[u8]) -> Result<u64> {
    let path = root.join("history.jsonl");
    let write = || -> std::io::Result<()> {
        let mut file = OpenOptions::new().create(true).truncate(false).write(true).open(&path)?;
        file.set_len(length)?;
        file.seek(SeekFrom::Start(length))?;
        file.write_all(lines)?;
        file.sync_all()
    };
    write().with_context(|| durable::cannot_write(&path))?;
    Ok(length + lines.len() as u64)
}

/// Writes the file anew with the steps of `history`, the last of whose records is `seq`; returns its length.
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
        Act::Step { title: title.clone(), changes: changes.clone(), continues: false }
    });
    let taken_back = std::iter::repeat_n(Act::Undo { edits: Vec::new() }, undone);
    let mut lines = Vec::new();
    for (act, number) in made.chain(taken_back).zip(first..) {
        lines.extend(Record { seq: number, act }.line()?);
    }
    durable::replace(&root.join("history.jsonl"), &lines)?;
    Ok(lines.len() as u64)
}

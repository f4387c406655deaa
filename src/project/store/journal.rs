use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use serde::{Deserialize, Serialize};

use super::durable;
use crate::{Change, Edit, History, Project, Step};
use ostra_core::disk;

/// One line of the journal and of the history.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Counts the project's records from 1 through its whole life.
    pub seq: u64,
    /// What happened.
    pub act: Act,
}

/// What a record says. Every act holds its edits, so that the project's state needs no history.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Act {
    /// A step was made.
    Step {
        /// For people.
        title: String,
        /// The changes with their inverses.
        changes: Vec<Change>,
        /// These changes belong to the step before (a tracking run arrives in pieces).
        #[serde(default)]
        continues: bool,
    },
    /// The last step was taken back by these edits.
    Undo {
        /// Inverses, last change first.
        edits: Vec<Edit>,
    },
    /// The step taken back last was done again by these edits.
    Redo {
        /// In order.
        edits: Vec<Edit>,
    },
}

impl Record {
    /// Does to the project what the record says.
    ///
    /// # Errors
    /// When an edit is refused: the record belongs to another state.
    pub fn replay(&self, project: &mut Project) -> Result<()> {
        let again: Vec<Edit> = match &self.act {
            Act::Step { changes, .. } => changes.iter().map(|change| change.edit.clone()).collect(),
            Act::Undo { edits } | Act::Redo { edits } => edits.clone(),
        };
        for edit in again {
            project.apply(edit)?;
        }
        Ok(())
    }

    /// Does to the history what the record says.
    pub fn fold(self, history: &mut History) {
        match self.act {
            Act::Step {
                title,
                changes,
                continues: false,
            } => history.push(Step { title, changes }),
            Act::Step {
                title,
                changes,
                continues: true,
            } => history.extend(Step { title, changes }),
            Act::Undo { .. } => history.undo(),
            Act::Redo { .. } => history.redo(),
        }
    }

    /// The record as one line of JSON with its line break.
    ///
    /// # Errors
    /// When a value has no JSON form.
    pub fn line(&self) -> Result<Vec<u8>> {
        let mut line = serde_json::to_vec(self)?;
        line.push(b'\n');
        Ok(line)
    }
}

/// A larger journal or history is refused.
const MAX_BYTES: u64 = 4 << 30;

/// A file of [`Record`]s, one a line, that only grows; each line is on the disk before [`Journal::append`] returns.
#[derive(Debug)]
pub struct Journal {
    path: PathBuf,
    file: File,
    /// Length of the whole lines.
    length: u64,
    /// Number and end of each line.
    ends: Vec<(u64, u64)>,
    /// A failed line could not be taken away again.
    broken: bool,
}

/// The records of a file and how many of its bytes are whole lines.
#[derive(Debug, Default)]
pub struct ReadRecords {
    /// In the file's order.
    pub records: Vec<Record>,
    /// Where each record's line ends, in bytes.
    pub ends: Vec<u64>,
    /// Why the lines after these records are not used, where there are any.
    pub rest: Option<Rest>,
    /// Whether the last line was not written to its end: a kill or a full disk.
    pub is_torn: bool,
}

/// Complete lines of a file of records that are not used.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rest {
    /// What is wrong, with the number of the line.
    pub why: String,
    /// How many complete lines follow the one that is wrong.
    pub after: usize,
}

impl ReadRecords {
    /// Leaves out the records from this one on.
    pub fn cut(&mut self, first: usize, why: String) {
        let after =
            (self.records.len() - first - 1) + self.rest.take().map_or(0, |rest| rest.after + 1);
        self.records.truncate(first);
        self.ends.truncate(first);
        self.rest = Some(Rest { why, after });
    }

    /// Bytes of the lines of the records.
    fn length(&self) -> u64 {
        self.ends.last().copied().unwrap_or(0)
    }
}

/// Reads a file of records; a missing file has none. A torn last line is left out, and so is all from the first complete
/// line on that is no record.
///
/// # Errors
/// When the file cannot be read.
pub fn read_records(path: &Path) -> Result<ReadRecords> {
    let bytes = match disk::read_regular_up_to(path, MAX_BYTES) {
        Ok(bytes) => bytes,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Vec::new(),
        Err(error) => {
            return Err(error).with_context(|| format!("{}: cannot be read", path.display()));
        }
    };
    let torn = bytes
        .split(|&byte| byte == b'\n')
        .next_back()
        .unwrap_or_default();
    let mut read = ReadRecords {
        is_torn: !torn.is_empty(),
        ..ReadRecords::default()
    };
    let mut end = 0;
    let mut lines = bytes
        .split_inclusive(|&byte| byte == b'\n')
        .filter(|line| line.ends_with(b"\n"));
    while let Some(line) = lines.next() {
        end += line.len();
        match serde_json::from_slice(line) {
            Ok(record) => {
                read.records.push(record);
                read.ends.push(end as u64);
            }
            Err(_) => {
                let why = format!("line {} is damaged", read.records.len() + 1);
                read.rest = Some(Rest {
                    why,
                    after: lines.count(),
                });
                break;
            }
        }
    }
    if read.rest.is_none() && read.is_torn && !is_begun_record(torn) {
        read.rest = Some(Rest {
            why: format!("line {} is damaged", read.records.len() + 1),
            after: 0,
        });
        read.is_torn = false;
    }
    Ok(read)
}

/// Whether bytes can be a record that was not written to its end: a kill or a full disk leaves its start, a power failure
/// may leave zeros in place of all that follows.
fn is_begun_record(line: &[u8]) -> bool {
    let zeros = line.iter().rev().take_while(|&&byte| byte == 0).count();
    let line = &line[..line.len() - zeros];
    let begin = br#"{"seq":"#;
    let common = line.len().min(begin.len());
    line[..common] == begin[..common] && !line.iter().any(u8::is_ascii_control)
}

impl Journal {
    /// Opens the file at `path` for appending after the whole lines that were read from it; what follows them is
    /// cut off.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn open(path: &Path, read: &ReadRecords) -> Result<Self> {
        let length = read.length();
        let open = || -> std::io::Result<File> {
            let mut file = disk::open_in_place(path)?;
            if file.metadata()?.len() > length {
                file.set_len(length)?;
                file.sync_all()?;
            }
            file.seek(SeekFrom::Start(length))?;
            Ok(file)
        };
        let file = open().with_context(|| durable::cannot_write(path))?;
        let ends = read
            .records
            .iter()
            .map(|record| record.seq)
            .zip(read.ends.iter().copied())
            .collect();
        Ok(Self {
            path: path.to_owned(),
            file,
            length,
            ends,
            broken: false,
        })
    }

    /// Bytes in the file.
    pub fn length(&self) -> u64 {
        self.length
    }

    /// Writes a record and waits until it is on the disk.
    ///
    /// # Errors
    /// When it cannot be written (a full disk); the file is as before.
    pub fn append(&mut self, record: &Record) -> Result<()> {
        if self.broken {
            bail!(
                "{}: an earlier write failed; open the project again",
                self.path.display()
            );
        }
        let line = record.line()?;
        let written = self
            .file
            .write_all(&line)
            .and_then(|()| self.file.sync_data());
        if let Err(error) = written {
            self.take_back();
            return Err(error).with_context(|| {
                format!(
                    "{}: the step cannot be saved and was not made",
                    self.path.display()
                )
            });
        }
        self.length += line.len() as u64;
        self.ends.push((record.seq, self.length));
        Ok(())
    }

    fn take_back(&mut self) {
        let cut = self
            .file
            .set_len(self.length)
            .and_then(|()| self.file.seek(SeekFrom::Start(self.length)));
        self.broken = cut.and_then(|_| self.file.sync_data()).is_err();
    }

    /// The records up to `seq` as they stand in the file, without those up to `after`.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn lines_between(&self, after: u64, seq: u64) -> Result<Vec<u8>> {
        let bytes = disk::read_regular(&self.path)
            .with_context(|| format!("{}: cannot be read", self.path.display()))?;
        let lines = bytes.get(self.end_of(after) as usize..self.end_of(seq) as usize);
        let changed = || {
            format!(
                "{}: was changed by another program; open the project again",
                self.path.display()
            )
        };
        lines.map(<[u8]>::to_vec).with_context(changed)
    }

    /// Takes away the records up to `seq`, which `project.toml` and the history have by now.
    ///
    /// # Errors
    /// When the file cannot be written; it is as before.
    pub fn forget(&mut self, seq: u64) -> Result<()> {
        let cut = self.end_of(seq);
        if cut == 0 {
            return Ok(());
        }
        let rest = self.lines_between(seq, u64::MAX)?;
        durable::replace(&self.path, &rest)?;
        // From here on the open file is no longer the one of this name: nothing may be appended to it.
        self.broken = true;
        let reopen = || -> std::io::Result<File> {
            let mut file = disk::open_in_place(&self.path)?;
            file.seek(SeekFrom::Start(rest.len() as u64))?;
            Ok(file)
        };
        self.file = reopen().with_context(|| durable::cannot_write(&self.path))?;
        self.broken = false;
        self.length -= cut;
        self.ends.retain(|&(number, _)| number > seq);
        self.ends.iter_mut().for_each(|(_, end)| *end -= cut);
        Ok(())
    }

    /// Where the lines of records up to `seq` end.
    fn end_of(&self, seq: u64) -> u64 {
        self.ends
            .iter()
            .take_while(|&&(number, _)| number <= seq)
            .last()
            .map_or(0, |&(_, end)| end)
    }
}

use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use serde::{Deserialize, Serialize};

use super::durable;
use crate::{Change, Edit, History, Project, Step};
use ostra_core::disk;

/// One line of the journal or the history.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JournalRecord {
    /// Number of the record, counted from 1 over the whole life of the project.
    pub seq: u64,
    /// What happened.
    pub act: Act,
}

/// The content of a record.
///
/// Every act holds its edits, so that the project's state can be restored without the history.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Act {
    /// A step was made.
    Step {
        /// Title to display.
        title: String,
        /// The changes with their inverses.
        changes: Vec<Change>,
        /// Whether the changes belong to the step before; a tracking run arrives in parts.
        #[serde(default)]
        continues: bool,
    },
    /// The last step was undone by these edits.
    Undo {
        /// Inverses, last change first.
        edits: Vec<Edit>,
    },
    /// The last undone step was redone by these edits.
    Redo {
        /// Edits in order.
        edits: Vec<Edit>,
    },
}

impl JournalRecord {
    /// Applies the record to the project.
    ///
    /// # Errors
    ///
    /// Returns an error if an edit is rejected because the record belongs to another state.
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

    /// Applies the record to the history.
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

    /// Returns the record as one line of JSON with its line break.
    ///
    /// # Errors
    ///
    /// Returns an error if a value cannot be represented in JSON.
    pub fn line(&self) -> Result<Vec<u8>> {
        let mut line = serde_json::to_vec(self)?;
        line.push(b'\n');
        Ok(line)
    }
}

/// Maximum size of a journal or history that is read.
const MAX_BYTES: u64 = 4 << 30;

/// An append-only file of [`JournalRecord`]s, one per line.
///
/// Each line is on disk before [`Journal::append`] returns.
#[derive(Debug)]
pub struct Journal {
    path: PathBuf,
    file: File,
    /// Length of the complete lines, in bytes.
    length: u64,
    /// Record number and end of each line.
    ends: Vec<(u64, u64)>,
    /// Whether a failed line could not be removed again.
    broken: bool,
}

/// The records of a file and the extent of its complete lines.
#[derive(Debug, Default)]
pub struct ReadRecords {
    /// Records in the order of the file.
    pub records: Vec<JournalRecord>,
    /// End of each record's line, in bytes.
    pub ends: Vec<u64>,
    /// Lines after these records that are not used, if any.
    pub rest: Option<UnusedRecords>,
    /// Whether the last line is incomplete because of a kill or a full disk.
    pub is_torn: bool,
}

/// Complete lines of a record file that are not used.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UnusedRecords {
    /// Description of the problem, with the line number.
    pub why: String,
    /// Number of complete lines after the bad one.
    pub after: usize,
}

impl ReadRecords {
    /// Drops the records from index `first` on.
    pub fn cut(&mut self, first: usize, why: String) {
        let after =
            (self.records.len() - first - 1) + self.rest.take().map_or(0, |rest| rest.after + 1);
        self.records.truncate(first);
        self.ends.truncate(first);
        self.rest = Some(UnusedRecords { why, after });
    }

    /// Returns the length of the records' lines, in bytes.
    fn length(&self) -> u64 {
        self.ends.last().copied().unwrap_or(0)
    }
}

/// Reads a file of records; a missing file has none.
///
/// An incomplete last line is left out. So is everything from the first complete line that is not a
/// record.
///
/// # Errors
///
/// Returns an error if the file cannot be read.
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
                read.rest = Some(UnusedRecords {
                    why,
                    after: lines.count(),
                });
                break;
            }
        }
    }
    if read.rest.is_none() && read.is_torn && !is_begun_record(torn) {
        read.rest = Some(UnusedRecords {
            why: format!("line {} is damaged", read.records.len() + 1),
            after: 0,
        });
        read.is_torn = false;
    }
    Ok(read)
}

/// Returns whether bytes can be an incomplete record.
///
/// A kill or a full disk leaves the start of a record. A power failure may leave zeros in place of
/// the rest.
fn is_begun_record(line: &[u8]) -> bool {
    let zeros = line.iter().rev().take_while(|&&byte| byte == 0).count();
    let line = &line[..line.len() - zeros];
    let begin = br#"{"seq":"#;
    let common = line.len().min(begin.len());
    line[..common] == begin[..common] && !line.iter().any(u8::is_ascii_control)
}

impl Journal {
    /// Opens the file at `path` for appending after the complete lines that were read from it.
    ///
    /// Anything after these lines is cut off.
    ///
    /// # Errors
    ///
    /// Returns an error if the file cannot be written.
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

    /// Returns the length of the file, in bytes.
    pub fn length(&self) -> u64 {
        self.length
    }

    /// Writes a record and syncs the file.
    ///
    /// # Errors
    ///
    /// Returns an error if it cannot be written, for example because the disk is full. The file is
    /// then unchanged.
    pub fn append(&mut self, record: &JournalRecord) -> Result<()> {
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

    /// Returns the lines of the records after `after` and up to `seq`.
    ///
    /// # Errors
    ///
    /// Returns an error if the file cannot be read.
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

    /// Removes the records up to `seq`, which `project.toml` and the history already contain.
    ///
    /// # Errors
    ///
    /// Returns an error if the file cannot be written. It is then unchanged.
    pub fn forget(&mut self, seq: u64) -> Result<()> {
        let cut = self.end_of(seq);
        if cut == 0 {
            return Ok(());
        }
        let rest = self.lines_between(seq, u64::MAX)?;
        durable::replace(&self.path, &rest)?;
        // The open file no longer has this name, so nothing may be appended to it.
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

    /// Returns the end of the lines of records up to `seq`, in bytes.
    fn end_of(&self, seq: u64) -> u64 {
        self.ends
            .iter()
            .take_while(|&&(number, _)| number <= seq)
            .last()
            .map_or(0, |&(_, end)| end)
    }
}

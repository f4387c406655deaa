//! Long work that has not finished, recorded in the project's folder, so that it can be continued.

use std::io::{ErrorKind, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use ostra_core::disk;

use crate::Command;

/// File in the project's folder: the command on the first line, then the shares done, one per line.
///
/// A share is appended without syncing, because it is only shown. The file is removed when the work
/// has finished; programs that do not know it leave it alone.
const FILE: &str = "unfinished.jsonl";

/// Maximum size of the file, in bytes.
const MAX_BYTES: u64 = 1 << 20;

/// Increase of the share done at which it is written again.
const STEP: f64 = 0.05;

/// Work that was interrupted: stopped, or running when the program ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Unfinished {
    /// Command that continues it, with the same options.
    pub command: Command,
    /// Share that was done, from 0 to 1.
    pub fraction: f64,
}

impl Unfinished {
    /// Returns the recorded work of a project; `None` if all has finished.
    ///
    /// A damaged record counts as none.
    #[must_use]
    pub fn read(root: &Path) -> Option<Self> {
        let bytes = disk::read_regular_up_to(&root.join(FILE), MAX_BYTES).ok()?;
        let text = String::from_utf8_lossy(&bytes);
        let mut lines = text.lines();
        let command = serde_json::from_str(lines.next()?).ok()?;
        let shares = lines.filter_map(|line| serde_json::from_str::<f64>(line).ok());
        let fraction = shares
            .filter(|share| (0.0..=1.0).contains(share))
            .fold(0.0, f64::max);
        // A project may come from a stranger: nothing but this command is ever offered.
        matches!(command, Command::Reconstruct(_)).then_some(Self { command, fraction })
    }
}

/// The record of the running job.
#[derive(Debug)]
pub(crate) struct RunningRecord {
    path: PathBuf,
    command: Command,
    written: f64,
}

impl RunningRecord {
    /// Writes the record of a command that begins.
    ///
    /// # Errors
    ///
    /// Returns an error if the file cannot be written.
    pub fn begin(root: &Path, command: &Command) -> Result<Self> {
        let path = root.join(FILE);
        let line = format!("{}\n", serde_json::to_string(command)?);
        disk::write(&path, line.as_bytes())?;
        Ok(Self {
            path,
            command: command.clone(),
            written: 0.0,
        })
    }

    /// Appends the share done, if it has grown enough.
    ///
    /// # Errors
    ///
    /// Returns an error if the file cannot be written.
    pub fn note(&mut self, fraction: f64) -> Result<()> {
        if fraction < self.written + STEP {
            return Ok(());
        }
        self.written = fraction;
        let mut file = disk::open_in_place(&self.path)?;
        file.seek(SeekFrom::End(0))?;
        Ok(writeln!(file, "{fraction:.3}")?)
    }

    /// Returns whether the record is that of a command.
    pub fn is_of(&self, command: Option<&Command>) -> bool {
        command == Some(&self.command)
    }

    /// Returns the work as it can be continued.
    pub fn into_unfinished(self, fraction: Option<f64>) -> Unfinished {
        Unfinished {
            command: self.command,
            fraction: fraction.unwrap_or(self.written),
        }
    }

    /// Removes the record of a project.
    ///
    /// # Errors
    ///
    /// Returns an error if there is one and it cannot be removed.
    pub fn remove(root: &Path) -> Result<()> {
        let path = root.join(FILE);
        match std::fs::remove_file(&path) {
            Err(error) if error.kind() != ErrorKind::NotFound => {
                Err(error).with_context(|| format!("{}: cannot be removed", path.display()))
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ostra_project::ReconstructRequest;

    fn reconstruct() -> Command {
        Command::Reconstruct(ReconstructRequest {
            every: 3,
            max_side: Some(800),
            ..ReconstructRequest::default()
        })
    }

    #[test]
    fn record_has_the_options_and_the_last_share() {
        let dir = tempfile::tempdir().unwrap();
        assert_eq!(Unfinished::read(dir.path()), None);
        let mut record = RunningRecord::begin(dir.path(), &reconstruct()).unwrap();
        for fraction in [0.01, 0.2, 0.22, 0.4] {
            record.note(fraction).unwrap();
        }
        // A kill may cut off the last line.
        let mut file = disk::open_in_place(&dir.path().join(FILE)).unwrap();
        file.seek(SeekFrom::End(0)).unwrap();
        file.write_all(b"0.").unwrap();
        let expected = Unfinished {
            command: reconstruct(),
            fraction: 0.4,
        };
        assert_eq!(Unfinished::read(dir.path()), Some(expected));
    }

    #[test]
    fn damaged_or_foreign_records_offer_nothing() {
        let dir = tempfile::tempdir().unwrap();
        for text in [
            "",
            "{\"recon",
            "{\"inspect\":\"/etc/passwd\"}\n0.5\n",
            "\"close\"\n",
        ] {
            std::fs::write(dir.path().join(FILE), text).unwrap();
            assert_eq!(Unfinished::read(dir.path()), None, "{text}");
        }
    }
}

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};
use sha2::{Digest, Sha256};

use super::checkpoint::{Checkpoint, Written};
use super::journal::{Journal, ReadRecords};
use super::load::StoredState;
use super::lock::Lock;
use super::{Act, JournalRecord, contained, durable, load, manifest};
use crate::{History, Project};
use ostra_core::disk;
use ostra_core::job::Progress;

/// Journal size in bytes above which a checkpoint is due.
const JOURNAL_BYTES: u64 = 8 << 20;

/// How often a project that another process writes is read until its files agree.
const TRIES: usize = 40;

/// A project's folder. While open for writing, it is locked against other writers.
#[derive(Debug)]
pub struct Folder {
    root: PathBuf,
    access: Access,
    /// Number of the last record.
    seq: u64,
    written: Written,
    /// Journal size in bytes above which a checkpoint is due.
    due_bytes: u64,
}

/// Access to a folder.
#[derive(Debug)]
enum Access {
    /// Steps are appended to the journal.
    Write { journal: Journal, _lock: Lock },
    /// Nothing is written, for the given reason.
    View { why: String },
}

/// A project as loaded from its folder.
#[derive(Debug)]
pub struct Loaded {
    /// The folder, locked if it was opened for writing.
    pub folder: Folder,
    /// State after the last complete record.
    pub project: Project,
    /// Steps that lead to this state.
    pub history: History,
    /// Warnings for the user, one line each.
    pub warnings: Vec<String>,
}

impl Folder {
    /// Creates a project's folder at `root`, which must be missing or empty.
    ///
    /// If that fails, everything that was created is removed again.
    ///
    /// # Errors
    ///
    /// Returns an error if the folder is not empty, or cannot be written.
    pub fn create(root: &Path, project: &Project) -> Result<Self> {
        Self::check_new(root)?;
        let made = make_folders(root)?;
        let created = Self::create_in(root, project);
        if created.is_err() {
            remove_empty(&made);
        }
        created
    }

    /// Checks that a new project can be created at a path.
    ///
    /// # Errors
    ///
    /// Returns an error if the folder is not empty or cannot be read.
    pub fn check_new(root: &Path) -> Result<()> {
        let mut entries = match std::fs::read_dir(root) {
            Ok(entries) => entries,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(()),
            Err(error) => bail!(
                "{}: cannot hold a project ({error}); choose another folder",
                root.display()
            ),
        };
        ensure!(
            !root.join("project.toml").exists(),
            "{}: already holds a project; open it instead",
            root.display()
        );
        let is_empty = entries.all(|entry| entry.is_ok_and(|entry| is_remains(&entry)));
        ensure!(
            is_empty,
            "{}: is not empty; choose a new or empty folder",
            root.display()
        );
        Ok(())
    }

    fn create_in(root: &Path, project: &Project) -> Result<Self> {
        // A parent folder that cannot be listed is not an error.
        let _ = root.parent().map(durable::sync_folder);
        let lock = Lock::take(root)?;
        // Another process may have created a project here in the meantime.
        Self::check_new(root)?;
        let path = root.join("journal.jsonl");
        let journal = Journal::open(&path, &ReadRecords::default());
        let written =
            journal.and_then(|journal| manifest::write(root, project, 0).map(|()| journal));
        let journal = written.inspect_err(|_| {
            for made in [path, root.join("project.toml"), root.join(".lock")] {
                let _ = std::fs::remove_file(made);
            }
        })?;
        Ok(Self {
            root: root.to_owned(),
            access: Access::Write {
                journal,
                _lock: lock,
            },
            seq: 0,
            written: Written::default(),
            due_bytes: JOURNAL_BYTES,
        })
    }

    /// Opens the project in `root` for writing.
    ///
    /// Reads the last checkpoint and then the journal. Damaged files are set aside, and leftovers
    /// of killed runs are removed.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no project, its format is newer, or it is damaged beyond use.
    /// Also fails if the project is open elsewhere or not writable ([`super::LockError`]), or if a
    /// link leads out of its folder. The folder is then unchanged.
    pub fn open(root: &Path, progress: &Progress) -> Result<Loaded> {
        contained::check(root)?;
        manifest::check_format(root)?;
        let lock = Lock::take(root)?;
        let mut state = load::state(root, progress)?;
        durable::remove_leftovers(root);
        for damage in std::mem::take(&mut state.damages) {
            state.warnings.push(damage.set_aside()?);
        }
        let journal = Journal::open(&root.join("journal.jsonl"), &state.journal)?;
        Ok(Self::loaded(
            root,
            Access::Write {
                journal,
                _lock: lock,
            },
            state,
        ))
    }

    /// Opens the project in `root` for viewing; `why` says why no step can be made.
    ///
    /// Nothing is written there, not even a lock. The project may therefore be on read-only media,
    /// and another process may write to it.
    ///
    /// # Errors
    ///
    /// Returns the errors of [`Self::open`], except those about write access.
    pub fn view(root: &Path, why: &str, progress: &Progress) -> Result<Loaded> {
        contained::check(root)?;
        manifest::check_format(root)?;
        for _ in 0..TRIES {
            let before = fingerprint(root)?;
            let read = load::state(root, progress);
            progress.check()?;
            // A checkpoint changes both files, so data read during a checkpoint may mix two states.
            if fingerprint(root)? != before {
                continue;
            }
            let mut state = read?;
            let damages = std::mem::take(&mut state.damages);
            state
                .warnings
                .extend(damages.iter().map(super::damage::Damage::warning));
            return Ok(Self::loaded(
                root,
                Access::View {
                    why: why.to_owned(),
                },
                state,
            ));
        }
        bail!(
            "{}: another process changes it faster than it can be read; try again",
            root.display()
        )
    }

    fn loaded(root: &Path, access: Access, state: StoredState) -> Loaded {
        let (history_seq, history_length) = state.history_end;
        let written = Written {
            seq: state.checkpoint,
            masks: state.masks,
            sparse: None,
            history_length,
            history_seq,
        };
        let folder = Self {
            root: root.to_owned(),
            access,
            seq: state.seq,
            written,
            due_bytes: JOURNAL_BYTES,
        };
        Loaded {
            folder,
            project: state.project,
            history: state.history,
            warnings: state.warnings,
        }
    }

    /// Returns the path of the folder.
    #[must_use]
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Returns why no step can be made, or `None` if the project is open for writing.
    #[must_use]
    pub fn view_reason(&self) -> Option<&str> {
        match &self.access {
            Access::View { why } => Some(why),
            Access::Write { .. } => None,
        }
    }

    /// Checks that results can be saved.
    ///
    /// # Errors
    ///
    /// Returns an error if the project is open for viewing.
    pub fn check_writable(&self) -> Result<()> {
        match &self.access {
            Access::Write { .. } => Ok(()),
            Access::View { why } => {
                bail!(
                    "{}: is open for viewing, and no change can be saved: {why}",
                    self.root.display()
                )
            }
        }
    }

    fn journal(&mut self) -> Result<&mut Journal> {
        self.check_writable()?;
        match &mut self.access {
            Access::Write { journal, .. } => Ok(journal),
            Access::View { .. } => bail!("the project is open for viewing"),
        }
    }

    /// Appends an act to the journal on disk.
    ///
    /// # Errors
    ///
    /// Returns an error if it cannot be written, for example because the disk is full. The folder
    /// is then unchanged, and the step must not be made.
    pub fn append(&mut self, act: Act) -> Result<JournalRecord> {
        let record = JournalRecord {
            seq: self.seq + 1,
            act,
        };
        self.journal()?.append(&record)?;
        self.seq = record.seq;
        Ok(record)
    }

    /// Returns whether the journal has grown so long that a checkpoint should be written.
    #[must_use]
    pub fn is_due(&self) -> bool {
        matches!(&self.access, Access::Write { journal, .. } if journal.length() > self.due_bytes)
    }

    /// Returns whether anything happened since the last checkpoint.
    #[must_use]
    pub fn is_unwritten(&self) -> bool {
        self.seq > self.written.seq
    }

    /// Collects what a checkpoint of this state writes.
    ///
    /// [`Checkpoint::write`] then does the work, on any thread.
    ///
    /// # Errors
    ///
    /// Returns an error if the journal cannot be read.
    pub fn checkpoint(&mut self, project: &Arc<Project>, history: &History) -> Result<Checkpoint> {
        let (history_seq, seq) = (self.written.history_seq, self.seq);
        let journal = self.journal()?;
        let (length, lines) = (journal.length(), journal.lines_between(history_seq, seq)?);
        // If this checkpoint fails, the next one is not tried immediately.
        self.due_bytes = length + JOURNAL_BYTES;
        Ok(Checkpoint {
            root: self.root.clone(),
            project: Arc::clone(project),
            history: history.clone(),
            lines,
            seq: self.seq,
            before: self.written.clone(),
        })
    }

    /// Notes that a checkpoint was written and shortens the journal.
    ///
    /// # Errors
    ///
    /// Returns an error if the journal cannot be rewritten. It is then unchanged, only longer than
    /// necessary.
    pub fn written(&mut self, written: Written) -> Result<()> {
        if written.seq < self.written.seq {
            return Ok(()); // a later one was written meanwhile
        }
        let seq = written.seq;
        self.written = written;
        self.journal()?.forget(seq)?;
        self.due_bytes = JOURNAL_BYTES;
        Ok(())
    }
}

/// Returns a digest of the files that together determine the state of a project.
fn fingerprint(root: &Path) -> Result<Vec<u8>> {
    let mut digest = Sha256::new();
    for name in ["project.toml", "journal.jsonl"] {
        let path = root.join(name);
        let cannot = || format!("{}: cannot be read", path.display());
        let mut reader = match disk::open_regular(&path) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => continue,
            opened => BufReader::with_capacity(1 << 20, opened.with_context(cannot)?),
        };
        let mut length = 0;
        loop {
            let bytes = reader.fill_buf().with_context(cannot)?;
            if bytes.is_empty() {
                break;
            }
            digest.update(bytes);
            let read = bytes.len();
            reader.consume(read);
            length += read;
        }
        digest.update(length.to_le_bytes());
    }
    Ok(digest.finalize().to_vec())
}

/// Creates a folder and its parents.
///
/// Returns the folders that were created, the innermost first.
fn make_folders(root: &Path) -> Result<Vec<PathBuf>> {
    let is_missing = |folder: &&Path| !folder.as_os_str().is_empty() && !folder.exists();
    let missing: Vec<&Path> = root.ancestors().take_while(is_missing).collect();
    let mut made = Vec::new();
    for folder in missing.into_iter().rev() {
        match std::fs::create_dir(folder) {
            Ok(()) => made.insert(0, folder.to_owned()),
            // Another process was faster.
            Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => {}
            Err(error) => {
                remove_empty(&made);
                return Err(error).with_context(|| durable::cannot_write(folder));
            }
        }
    }
    Ok(made)
}

/// Removes those of the folders that are still empty, in this order.
fn remove_empty(folders: &[PathBuf]) {
    for folder in folders {
        let _ = std::fs::remove_dir(folder);
    }
}

/// Returns whether a file is left over from a run that was killed while creating a project.
fn is_remains(entry: &std::fs::DirEntry) -> bool {
    let name = entry.file_name();
    let is_empty = entry
        .metadata()
        .is_ok_and(|found| found.is_file() && found.len() == 0);
    is_empty && (name == ".lock" || name == "journal.jsonl") || disk::is_temporary(&name)
}

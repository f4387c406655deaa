use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};
use sha2::{Digest, Sha256};

use super::checkpoint::{Checkpoint, Written};
use super::journal::{Journal, ReadRecords};
use super::load::State;
use super::lock::Lock;
use super::{Act, Record, contained, durable, load, manifest};
use crate::{History, Project};
use ostra_core::disk;
use ostra_core::job::Progress;

/// Beyond this many bytes of journal a checkpoint is due.
const JOURNAL_BYTES: u64 = 8 << 20;

/// How often a project that another process writes to is read again until both agree on its state.
const TRIES: usize = 40;

/// A project's folder. Opened for writing it is held against other writers while this lives.
#[derive(Debug)]
pub struct Folder {
    root: PathBuf,
    access: Access,
    /// Number of the last record made.
    seq: u64,
    written: Written,
    /// A checkpoint is due when the journal is longer than this.
    due_bytes: u64,
}

/// What may be done with a folder.
#[derive(Debug)]
enum Access {
    /// Steps are appended to the journal.
    Write { journal: Journal, _lock: Lock },
    /// Nothing is written, for this reason.
    View { why: String },
}

/// A project as it was found in its folder.
#[derive(Debug)]
pub struct Loaded {
    /// The folder, locked.
    pub folder: Folder,
    /// The state after the last whole record.
    pub project: Project,
    /// The steps that lead there.
    pub history: History,
    /// What the user should know, one line each.
    pub warnings: Vec<String>,
}

impl Folder {
    /// Makes a project's folder at `root` (missing or empty) with `project` in it. If that fails, what was made is
    /// taken away again.
    ///
    /// # Errors
    /// When the folder holds something, or cannot be written.
    pub fn create(root: &Path, project: &Project) -> Result<Self> {
        Self::check_new(root)?;
        let made = make_folders(root)?;
        let created = Self::create_in(root, project);
        if created.is_err() {
            remove_empty(&made);
        }
        created
    }

    /// Refuses a place where no new project can be made.
    ///
    /// # Errors
    /// When the folder holds something or cannot be read.
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
        // A folder above that cannot be listed is no reason not to go on.
        let _ = root.parent().map(durable::sync_folder);
        let lock = Lock::take(root)?;
        // Another process may have made a project here since.
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

    /// Opens the project in `root` for writing: the last checkpoint, then the journal. Files that are damaged are put aside,
    /// and what killed runs left is removed.
    ///
    /// # Errors
    /// When there is none, it is of a newer format, open elsewhere, damaged beyond use, not writable ([`super::LockError`]), or
    /// has a link that leads out of its folder; nothing is changed then.
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

    /// Opens the project in `root` for viewing: nothing is written there, not even a lock, so that it may be on read-only
    /// media, and another process may work in it. `why` says why no step can be made.
    ///
    /// # Errors
    /// As [`Self::open`], but for access.
    pub fn view(root: &Path, why: &str, progress: &Progress) -> Result<Loaded> {
        contained::check(root)?;
        manifest::check_format(root)?;
        for _ in 0..TRIES {
            let before = fingerprint(root)?;
            let read = load::state(root, progress);
            progress.check()?;
            // A checkpoint changes both files; what was read while it was written may be of two states.
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

    fn loaded(root: &Path, access: Access, state: State) -> Loaded {
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

    /// Where the project lies.
    #[must_use]
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Why no step can be made; `None` where the project is open for writing.
    #[must_use]
    pub fn view_reason(&self) -> Option<&str> {
        match &self.access {
            Access::View { why } => Some(why),
            Access::Write { .. } => None,
        }
    }

    /// Refuses work whose results could not be saved.
    ///
    /// # Errors
    /// When the project is open for viewing.
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

    /// Puts what happened on the disk.
    ///
    /// # Errors
    /// When it cannot be written (a full disk); the folder is as before, and the step must not be made.
    pub fn append(&mut self, act: Act) -> Result<Record> {
        let record = Record {
            seq: self.seq + 1,
            act,
        };
        self.journal()?.append(&record)?;
        self.seq = record.seq;
        Ok(record)
    }

    /// Whether the journal has grown so long that a checkpoint should be written.
    #[must_use]
    pub fn is_due(&self) -> bool {
        matches!(&self.access, Access::Write { journal, .. } if journal.length() > self.due_bytes)
    }

    /// Whether anything happened since the last checkpoint.
    #[must_use]
    pub fn is_unwritten(&self) -> bool {
        self.seq > self.written.seq
    }

    /// Gathers what a checkpoint of this state writes; the work itself is [`Checkpoint::write`], on any thread.
    ///
    /// # Errors
    /// When the journal cannot be read.
    pub fn checkpoint(&mut self, project: &Arc<Project>, history: &History) -> Result<Checkpoint> {
        let (history_seq, seq) = (self.written.history_seq, self.seq);
        let journal = self.journal()?;
        let (length, lines) = (journal.length(), journal.lines_between(history_seq, seq)?);
        // Should this one fail, the next is not tried at once.
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
    /// When the journal cannot be rewritten; it stands as before and is only longer than it must be.
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

/// A digest of the files that say together which state a project is in.
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

/// Makes a folder and those above it; returns those that were made here, the innermost first.
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

/// Removes folders that are still empty, in this order.
fn remove_empty(folders: &[PathBuf]) {
    for folder in folders {
        let _ = std::fs::remove_dir(folder);
    }
}

/// Whether a file is what a killed run left before it had made a project: nothing that anybody needs.
fn is_remains(entry: &std::fs::DirEntry) -> bool {
    let name = entry.file_name();
    let is_empty = entry
        .metadata()
        .is_ok_and(|found| found.is_file() && found.len() == 0);
    is_empty && (name == ".lock" || name == "journal.jsonl") || disk::is_temporary(&name)
}

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Result, bail, ensure};

use super::checkpoint::Checkpoint;
use super::journal::{Journal, ReadRecords, read_records};
use super::lock::Lock;
use super::mask_files::Runs;
use super::{Act, Record, durable, history_file, load, manifest};
use crate::engine::job::Progress;
use crate::frames::Frame;
use crate::session::{History, Project};

/// Beyond this many bytes of journal a checkpoint is due.
const JOURNAL_BYTES: u64 = 8 << 20;

/// A project's folder, held against other writers while this lives.
#[derive(Debug)]
pub struct Folder {
    root: PathBuf,
    journal: Journal,
    /// Number of the last record made.
    seq: u64,
    written: Written,
    /// A checkpoint is due when the journal is longer than this.
    due_bytes: u64,
    _lock: Lock,
}

/// What the files beside the journal hold.
#[derive(Debug, Clone, Default)]
pub struct Written {
    /// `project.toml`: the state after this record.
    pub seq: u64,
    /// The masks.
    pub masks: Runs,
    /// `sparse/`; `None` = not known.
    pub sparse: Option<WrittenSparse>,
    /// Bytes of whole lines in `history.jsonl`.
    pub history_length: u64,
    /// Number of the last record in `history.jsonl`.
    pub history_seq: u64,
}

/// What `sparse/` was written from.
#[derive(Debug, Clone)]
pub struct WrittenSparse {
    /// The frames whose cameras it holds.
    pub frames: Arc<Vec<Frame>>,
    /// The version of the points it holds.
    pub version: Option<u64>,
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
        let made = first_missing(root);
        let created = Self::create_in(root, project);
        if created.is_err() {
            remove_made(root, made.as_deref());
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
            Err(error) => bail!("{}: cannot hold a project ({error}); choose another folder", root.display()),
        };
        ensure!(!root.join("project.toml").exists(), "{}: already holds a project; open it instead", root.display());
        ensure!(entries.next().is_none(), "{}: is not empty; choose a new or empty folder", root.display());
        Ok(())
    }

    fn create_in(root: &Path, project: &Project) -> Result<Self> {
        durable::make_folder(root)?;
        // A folder above that cannot be listed is no reason not to go on.
        let _ = root.parent().map(durable::sync_folder);
        let lock = Lock::take(root)?;
        let journal = Journal::open(&root.join("journal.jsonl"), &ReadRecords::default())?;
        manifest::write(root, project, 0)?;
        Ok(Self {
            root: root.to_owned(),
            journal,
            seq: 0,
            written: Written::default(),
            due_bytes: JOURNAL_BYTES,
            _lock: lock,
        })
    }

    /// Opens the project in `root`: the last checkpoint, then the journal.
    ///
    /// # Errors
    /// When there is none, it is of a newer format, open elsewhere, damaged or not writable; nothing is changed then.
    pub fn open(root: &Path, progress: &Progress) -> Result<Loaded> {
        manifest::check_format(root)?;
        let lock = Lock::take(root)?;
        let manifest = manifest::read(root)?;
        let checkpoint = manifest.step;
        let path = root.join("journal.jsonl");
        let read = read_records(&path)?;
        let mut base = load::state(root, manifest, &read.records, progress)?;
        let mut past = history_file::read(root, checkpoint, &read.records, &mut base.warnings);
        let seq = read.records.last().map_or(checkpoint, |record| record.seq.max(checkpoint));
        let journal = Journal::open(&path, &read)?;
        for record in read.records.into_iter().filter(|record| record.seq > past.seq) {
            record.fold(&mut past.history);
        }
        let written = Written {
            seq: checkpoint,
            masks: base.masks,
            sparse: None,
            history_length: past.length,
            history_seq: past.seq,
        };
        let folder = Self { root: root.to_owned(), journal, seq, written, due_bytes: JOURNAL_BYTES, _lock: lock };
        Ok(Loaded { folder, project: base.project, history: past.history, warnings: base.warnings })
    }

    /// Where the project lies.
    #[must_use]
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Puts what happened on the disk.
    ///
    /// # Errors
    /// When it cannot be written (a full disk); the folder is as before, and the step must not be made.
    pub fn append(&mut self, act: Act) -> Result<Record> {
        let record = Record { seq: self.seq + 1, act };
        self.journal.append(&record)?;
        self.seq = record.seq;
        Ok(record)
    }

    /// Whether the journal has grown so long that a checkpoint should be written.
    #[must_use]
    pub fn is_due(&self) -> bool {
        self.journal.length() > self.due_bytes
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
        // Should this one fail, the next is not tried at once.
        self.due_bytes = self.journal.length() + JOURNAL_BYTES;
        Ok(Checkpoint {
            root: self.root.clone(),
            project: Arc::clone(project),
            history: history.clone(),
            lines: self.journal.lines_between(self.written.history_seq, self.seq)?,
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
        self.journal.forget(seq)?;
        self.due_bytes = JOURNAL_BYTES;
        Ok(())
    }
}

/// The topmost folder on the way to `root` that does not exist yet.
fn first_missing(root: &Path) -> Option<PathBuf> {
    root.ancestors().take_while(|folder| !folder.as_os_str().is_empty() && !folder.exists()).last().map(Path::to_owned)
}

fn remove_made(root: &Path, made: Option<&Path>) {
    if let Some(made) = made {
        let _ = std::fs::remove_dir_all(made);
        return;
    }
    for name in [".lock", "journal.jsonl", "project.toml"] {
        let _ = std::fs::remove_file(root.join(name));
    }
}

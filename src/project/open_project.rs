use std::path::Path;
use std::sync::Arc;

use anyhow::{Result, bail};

use crate::store::{self, Act, Checkpoint, Folder, HISTORY_BYTES, Loaded, Written};
use crate::{Change, Edit, History, Project, ResultKind, Step};
use ostra_core::job::JobId;
use ostra_core::job::Progress;
use ostra_frames::Frame;

/// A project with its folder and history.
///
/// A step is either made in memory and on disk, or not at all.
#[derive(Debug)]
pub struct OpenProject {
    project: Arc<Project>,
    history: History,
    folder: Folder,
    /// Run that made the last step, if that step can still grow.
    preview_cloud: Option<JobId>,
    /// Number of changes to the project since it was opened.
    revision: u64,
    /// Version of the results that is published under plain names; `None` if unknown.
    published: Option<Option<u64>>,
    /// Frames whose depth maps are published under plain names; `None` if unknown.
    published_depths: Option<Arc<Vec<Frame>>>,
}

impl OpenProject {
    /// Creates the open project from what was loaded from its folder.
    #[must_use]
    pub fn loaded(loaded: Loaded) -> Self {
        Self {
            project: Arc::new(loaded.project),
            history: loaded.history,
            folder: loaded.folder,
            preview_cloud: None,
            revision: 0,
            published: None,
            published_depths: None,
        }
    }

    /// Creates a folder for a new project.
    ///
    /// # Errors
    ///
    /// Returns the errors of [`Folder::create`].
    pub fn create(root: &Path, project: Project) -> Result<Self> {
        let folder = Folder::create(root, &project)?;
        Ok(Self {
            project: Arc::new(project),
            history: History::default(),
            folder,
            preview_cloud: None,
            revision: 0,
            published: None,
            published_depths: None,
        })
    }

    /// Returns the current project; cloning the `Arc` gives a cheap snapshot.
    #[must_use]
    pub fn project(&self) -> &Arc<Project> {
        &self.project
    }

    /// Returns a number that differs for each state of the project since it was opened.
    #[must_use]
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// Returns the steps done and undone.
    #[must_use]
    pub fn history(&self) -> &History {
        &self.history
    }

    /// Returns the run that made the last step, if that step can still grow.
    #[must_use]
    pub fn preview_run(&self) -> Option<JobId> {
        self.preview_cloud
    }

    /// Returns the project's folder.
    #[must_use]
    pub fn root(&self) -> &Path {
        self.folder.root()
    }

    /// Makes one step of the edits and of what they make stale.
    ///
    /// Edits that change nothing are left out. Returns whether any remained.
    ///
    /// # Errors
    ///
    /// Returns an error if an edit is rejected or the step cannot be saved. The project is then
    /// unchanged.
    pub fn commit(&mut self, title: &str, edits: Vec<Edit>) -> Result<bool> {
        self.make(title, edits, None)
    }

    /// Like [`Self::commit`], but consecutive edits of the same `run` become one step.
    ///
    /// # Errors
    ///
    /// Returns the errors of [`Self::commit`].
    pub fn commit_part(&mut self, title: &str, edits: Vec<Edit>, run: JobId) -> Result<bool> {
        self.make(title, edits, Some(run))
    }

    fn make(&mut self, title: &str, edits: Vec<Edit>, run: Option<JobId>) -> Result<bool> {
        let changes = apply_with_consequences(Arc::make_mut(&mut self.project), edits)?;
        if changes.is_empty() {
            return Ok(false);
        }
        let continues = run.is_some() && run == self.preview_cloud;
        let back = Step {
            title: String::new(),
            changes: changes.clone(),
        }
        .back();
        let act = Act::Step {
            title: title.to_owned(),
            changes,
            continues,
        };
        self.save(act, back)?;
        self.preview_cloud = run;
        Ok(true)
    }

    /// Undoes the last step and returns its title.
    ///
    /// # Errors
    ///
    /// Returns an error if there is none or it cannot be saved. The project is then unchanged.
    pub fn undo(&mut self) -> Result<String> {
        let Some(step) = self.history.last().cloned() else {
            bail!("there is nothing to undo")
        };
        let edits = step.back();
        self.move_by(
            &edits,
            step.forth(),
            Act::Undo {
                edits: edits.clone(),
            },
        )?;
        Ok(step.title.clone())
    }

    /// Redoes the last undone step and returns its title.
    ///
    /// # Errors
    ///
    /// Returns an error if there is none or it cannot be saved. The project is then unchanged.
    pub fn redo(&mut self) -> Result<String> {
        let Some(step) = self.history.next().cloned() else {
            bail!("there is nothing to redo")
        };
        let edits = step.forth();
        self.move_by(
            &edits,
            step.back(),
            Act::Redo {
                edits: edits.clone(),
            },
        )?;
        Ok(step.title.clone())
    }

    fn move_by(&mut self, edits: &[Edit], back: Vec<Edit>, act: Act) -> Result<()> {
        let mut moved = Project::clone(&self.project);
        for edit in edits {
            moved.apply(edit.clone())?;
        }
        self.project = Arc::new(moved);
        self.preview_cloud = None;
        self.save(act, back)
    }

    /// Returns a number for the files of a new result and creates its folder.
    ///
    /// # Errors
    ///
    /// Returns an error if the folder cannot be created, or the project is open for viewing.
    pub fn next_version(&self) -> Result<u64> {
        self.folder.check_writable()?;
        store::next_version(self.root(), &self.project, &self.history)
    }

    /// Returns why no step can be made, or `None` if the project is open for writing.
    #[must_use]
    pub fn view_reason(&self) -> Option<&str> {
        self.folder.view_reason()
    }

    /// Publishes the files of the current results under their plain names.
    ///
    /// Does nothing if the project is open for viewing.
    ///
    /// # Errors
    ///
    /// Returns an error if a file cannot be put in place.
    pub fn publish(&mut self) -> Result<()> {
        if self.view_reason().is_some() {
            return Ok(());
        }
        let version = store::version_in_force(&self.project, ResultKind::Cloud);
        if self.published != Some(version) {
            store::publish_cloud(self.root(), version)?;
            self.published = Some(version);
        }
        let frames = &self.project.frames;
        if self
            .published_depths
            .as_ref()
            .is_none_or(|published| !Arc::ptr_eq(published, frames))
        {
            store::publish_depths(self.root(), frames)?;
            self.published_depths = Some(Arc::clone(&self.project.frames));
        }
        Ok(())
    }

    /// Saves a change that the project already has to the disk and the history.
    ///
    /// If that fails, `back` reverts the project.
    fn save(&mut self, act: Act, back: Vec<Edit>) -> Result<()> {
        self.revision += 1;
        match self.folder.append(act) {
            Ok(record) => {
                record.fold(&mut self.history);
                Ok(())
            }
            Err(error) => {
                let project = Arc::make_mut(&mut self.project);
                back.into_iter()
                    .try_for_each(|edit| project.apply(edit).map(drop))?;
                Err(error)
            }
        }
    }

    /// Returns whether a checkpoint should be written because the journal is long.
    #[must_use]
    pub fn is_due(&self) -> bool {
        self.folder.is_due()
    }

    /// Collects what a checkpoint of the current state writes.
    ///
    /// # Errors
    ///
    /// Returns an error if the journal cannot be read.
    pub fn checkpoint(&mut self) -> Result<Checkpoint> {
        self.history.keep(2 * HISTORY_BYTES);
        self.folder.checkpoint(&self.project, &self.history)
    }

    /// Notes that a checkpoint was written.
    ///
    /// # Errors
    ///
    /// Returns an error if the journal cannot be shortened. No data is lost.
    pub fn written(&mut self, written: Written) -> Result<()> {
        self.folder.written(written)
    }

    /// Writes a checkpoint now if anything happened since the last one.
    ///
    /// # Errors
    ///
    /// Returns an error if a file cannot be written. The journal still holds everything.
    pub fn save_now(&mut self) -> Result<()> {
        if !self.folder.is_unwritten() || self.view_reason().is_some() {
            return Ok(());
        }
        let written = self.checkpoint()?.write(&Progress::default())?;
        self.written(written)
    }
}

/// Applies edits, each followed by what it makes stale.
///
/// Edits that change nothing are left out. Either all edits are applied or none.
fn apply_with_consequences(project: &mut Project, edits: Vec<Edit>) -> Result<Vec<Change>> {
    let mut changes: Vec<Change> = Vec::new();
    for edit in edits {
        let consequences = project.consequences(&edit);
        for edit in std::iter::once(edit).chain(consequences) {
            match project.apply(edit.clone()) {
                Ok(inverse) if changes_nothing(&edit, &inverse) => {}
                Ok(inverse) => changes.push(Change { edit, inverse }),
                Err(error) => {
                    for change in changes.into_iter().rev() {
                        project.apply(change.inverse)?;
                    }
                    return Err(error);
                }
            }
        }
    }
    Ok(changes)
}

fn changes_nothing(edit: &Edit, inverse: &Edit) -> bool {
    inverse == edit || matches!(inverse, Edit::SetStale { frames, .. } if frames.is_empty())
}

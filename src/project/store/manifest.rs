use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::{durable, source_paths};
use crate::{Marks, Project, ResultKind, ResultRecord};
use ostra_core::disk::read_text_up_to;
use ostra_frames::Frame;
use ostra_masks::{Label, LabelId, LabelTree, Prompt};

/// Version of the file format in a project's folder.
pub const FORMAT: u32 = 1;
/// Maximum size of `project.toml`; 100,000 frames with cameras take a fifth of it.
const MAX_BYTES: u64 = 512 << 20;

/// Content of `project.toml`: a [`Project`] without its masks.
#[derive(Debug, Serialize, Deserialize)]
pub struct Manifest {
    format: u32,
    /// Number of the last record of the journal that is included.
    pub step: u64,
    /// Folder of the project when the file was written.
    ///
    /// Paths of sources that share a folder with the project are relative to it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub folder: Option<PathBuf>,
    #[serde(default, skip_serializing_if = "is_zero")]
    origin: DVec3,
    #[serde(default)]
    labels: Vec<Label>,
    #[serde(default)]
    prompts: Vec<GivenPrompt>,
    #[serde(default)]
    marks: Vec<Marked>,
    #[serde(default)]
    results: BTreeMap<ResultKind, ResultRecord>,
    #[serde(default)]
    frames: Vec<Frame>,
}

fn is_zero(origin: &DVec3) -> bool {
    *origin == DVec3::ZERO
}

#[derive(Debug, Serialize, Deserialize)]
struct GivenPrompt {
    frame: usize,
    label: LabelId,
    prompt: Prompt,
}

#[derive(Debug, Serialize, Deserialize)]
struct Marked {
    label: LabelId,
    #[serde(flatten)]
    marks: Marks,
}

/// Checks that a folder holds a project whose format this program can read.
///
/// Nothing is changed.
///
/// # Errors
///
/// Returns an error if the folder holds no project, the project is of a newer program, or
/// `project.toml` is damaged.
pub fn check_format(root: &Path) -> Result<()> {
    #[derive(Deserialize)]
    struct Format {
        format: u32,
    }
    let path = root.join("project.toml");
    ensure!(
        root.exists(),
        "{}: there is no such folder; check the path",
        root.display()
    );
    ensure!(
        path.exists(),
        "{}: holds no project (project.toml is missing); make one with 'new'",
        root.display()
    );
    let text = text_of(&path)?;
    match toml::from_str::<Format>(&text) {
        Ok(Format { format: FORMAT }) => Ok(()),
        Ok(Format { format }) if format > FORMAT => bail!(
            "{}: was written by a newer program (format {format}, this one reads {FORMAT}); update this program",
            path.display()
        ),
        _ => bail!("{}: is damaged; restore it from a backup", path.display()),
    }
}

/// Reads `project.toml`.
///
/// # Errors
///
/// Returns an error if it cannot be read or is damaged.
pub fn read(root: &Path) -> Result<Manifest> {
    let path = root.join("project.toml");
    let text = text_of(&path)?;
    let parsed = toml::from_str(&text).map_err(|error| error.message().replace('\n', " "));
    match parsed {
        Ok(manifest) => Ok(manifest),
        Err(error) => bail!(
            "{}: is damaged ({error}); restore it from a backup",
            path.display()
        ),
    }
}

fn text_of(path: &Path) -> Result<String> {
    read_text_up_to(path, MAX_BYTES).with_context(|| format!("{}: cannot be read", path.display()))
}

/// Writes `project.toml` with the project's state after the record `step`.
///
/// # Errors
///
/// Returns an error if it cannot be written. The old file is then kept.
pub fn write(root: &Path, project: &Project, step: u64) -> Result<()> {
    let prompts = project.prompts.iter();
    let folder = std::path::absolute(root)
        .ok()
        .filter(|folder| folder.to_str().is_some());
    let mut frames = project.frames.to_vec();
    if let Some(folder) = &folder {
        frames
            .iter_mut()
            .for_each(|frame| source_paths::make_relative(frame, folder));
    }
    let manifest = Manifest {
        format: FORMAT,
        step,
        folder,
        origin: project.origin,
        labels: project.labels.iter().cloned().collect(),
        prompts: prompts
            .map(|(&(frame, label), prompt)| GivenPrompt {
                frame,
                label,
                prompt: prompt.clone(),
            })
            .collect(),
        marks: project
            .marks
            .iter()
            .map(|(&label, marks)| Marked {
                label,
                marks: marks.clone(),
            })
            .collect(),
        results: project.results.clone(),
        frames,
    };
    let text = toml::to_string(&manifest)
        .context("the project has a value that project.toml cannot hold")?;
    durable::replace(&root.join("project.toml"), text.as_bytes())
}

impl Manifest {
    /// Returns the project without its masks.
    ///
    /// Relative paths are resolved against the folder where the file was written. If that is
    /// unknown, they are resolved against `root`, the current folder.
    ///
    /// # Errors
    ///
    /// Returns an error if an invariant does not hold, because the file was edited by hand or
    /// damaged.
    pub fn into_project(mut self, root: &Path) -> Result<Project> {
        ensure!(
            self.origin.is_finite(),
            "the origin of its coordinates is not finite"
        );
        let home = self
            .folder
            .as_deref()
            .filter(|folder| folder.is_absolute())
            .unwrap_or(root);
        self.frames
            .iter_mut()
            .for_each(|frame| source_paths::make_absolute(frame, home));
        let mut project = Project {
            labels: tree(self.labels)?,
            results: self.results,
            origin: self.origin,
            ..Project::default()
        };
        project.apply(crate::Edit::AddFrames {
            frames: self.frames,
        })?;
        for GivenPrompt {
            frame,
            label,
            prompt,
        } in self.prompts
        {
            project.apply(crate::Edit::SetPrompt {
                frame,
                label,
                prompt: Some(prompt),
            })?;
        }
        for Marked { label, marks } in self.marks {
            project.apply(crate::Edit::SetMarks { label, marks })?;
        }
        Ok(project)
    }
}

/// Builds the label tree, adding each label after its parent.
fn tree(mut labels: Vec<Label>) -> Result<LabelTree> {
    let mut tree = LabelTree::default();
    while !labels.is_empty() {
        let (ready, waiting): (Vec<_>, Vec<_>) = labels
            .into_iter()
            .partition(|label| label.parent.is_none_or(|parent| tree.get(parent).is_some()));
        ensure!(
            !ready.is_empty(),
            "a label's parent does not exist or is its own descendant"
        );
        ready.into_iter().try_for_each(|label| tree.set(label))?;
        labels = waiting;
    }
    Ok(tree)
}

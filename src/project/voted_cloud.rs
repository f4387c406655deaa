//! The project's cloud with the votes behind its labels: reading, writing and relabelling.

use std::fs::File;
use std::io::{BufReader, BufWriter, Write};
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};

use crate::store::{cloud_path, votes_path};
use crate::{Project, ResultKind};
use ostra_cloud::fuse::{
    ChangedMask, ProjectViews, Votes, read_votes, relabel, vote_again, write_votes,
};
use ostra_cloud::ply::read_ply;
use ostra_cloud::{LabelledCloud, LabelledMesh, SceneError};
use ostra_core::disk::AtomicFile;
use ostra_core::job::Progress;
use ostra_frames::{Frame, FrameStore};

/// Maximum number of frames whose masks are decoded at once to vote again.
///
/// For more frames, the masks are read one after another.
const FEW: usize = 8;

/// Message for a missing file of a result.
pub const NOT_KEPT: &str = "the result of this step is not kept any more; fuse again";

/// A labelled cloud and the votes behind its labels.
#[derive(Debug, Clone)]
pub struct VotedCloud {
    /// Points of the cloud.
    pub cloud: Arc<LabelledCloud>,
    /// Votes on the points.
    pub votes: Arc<Votes>,
}

impl VotedCloud {
    /// Reads a version of a project's cloud.
    ///
    /// # Errors
    ///
    /// Returns an error if a file is missing or damaged, or the cloud and the votes do not belong
    /// together.
    pub fn read(root: &Path, version: u64, frames: &[Frame], progress: &Progress) -> Result<Self> {
        let cloud = read_ply(&cloud_path(root, version), progress)
            .context(NOT_KEPT)?
            .cloud;
        let votes = read_votes_on(&votes_path(root, version), cloud.len(), frames)?;
        Ok(Self {
            cloud: Arc::new(cloud),
            votes: Arc::new(votes),
        })
    }

    /// Returns whether the points can be relabelled from the votes.
    #[must_use]
    pub fn can_revote(&self) -> bool {
        can_revote(self.cloud.len(), &self.votes)
    }

    /// Returns the cloud with labels from the current masks.
    ///
    /// This is for work that must not depend on whether the cloud in a window was kept up to date.
    /// The cloud is returned unchanged if the frames that voted are unknown.
    ///
    /// # Errors
    ///
    /// Returns the errors of [`vote_again`].
    pub fn up_to_date(
        self,
        project: &Project,
        store: &FrameStore,
        progress: &Progress,
    ) -> Result<Self, SceneError> {
        if !is_stale(project) || !self.can_revote() {
            return Ok(self);
        }
        let voters: Vec<usize> = self.votes.frames().collect();
        let voted = self.relabelled(project, store, &voters, progress)?;
        Ok(voted.unwrap_or(self))
    }

    /// Returns the cloud with labels after a new vote of the changed frames.
    ///
    /// Returns `None` if nothing changes.
    ///
    /// # Errors
    ///
    /// Returns the errors of [`vote_again`].
    pub fn relabelled(
        &self,
        project: &Project,
        store: &FrameStore,
        changed: &[usize],
        progress: &Progress,
    ) -> Result<Option<Self>, SceneError> {
        let mask = |frame: usize| {
            project
                .mask_in_play(frame)
                .map(|runs| Arc::new(runs.decode()))
        };
        let (cloud, votes) = (&*self.cloud, &*self.votes);
        let (labelled, counted) = if changed.len() <= FEW {
            let changed: Vec<_> = changed
                .iter()
                .map(|&frame| ChangedMask {
                    frame,
                    mask: mask(frame),
                })
                .collect();
            relabel(cloud, votes, &changed, &project.labels, progress)?
        } else {
            let views = ProjectViews {
                frames: &project.frames,
                store,
                masks: &mask,
            };
            let voted = vote_again(cloud, votes, &views, &project.labels, progress)?;
            (voted.cloud, voted.votes)
        };
        let same = labelled.labels == cloud.labels
            && labelled.confidence == cloud.confidence
            && counted == *votes;
        Ok((!same).then(|| Self {
            cloud: Arc::new(labelled),
            votes: Arc::new(counted),
        }))
    }
}

/// Returns a mesh with labels from the current masks.
///
/// # Errors
///
/// Returns the errors of [`vote_again`].
pub fn relabelled_mesh(
    mesh: LabelledMesh,
    votes: &Votes,
    project: &Project,
    store: &FrameStore,
    progress: &Progress,
) -> Result<LabelledMesh, SceneError> {
    let masks = |frame: usize| {
        project
            .mask_in_play(frame)
            .map(|runs| Arc::new(runs.decode()))
    };
    let views = ProjectViews {
        frames: &project.frames,
        store,
        masks: &masks,
    };
    let vertices = vote_again(&mesh.vertices, votes, &views, &project.labels, progress)?.cloud;
    Ok(LabelledMesh { vertices, ..mesh })
}

/// Returns whether an input of the project's cloud has changed since it was made.
#[must_use]
pub fn is_stale(project: &Project) -> bool {
    project
        .results
        .get(&ResultKind::Cloud)
        .is_some_and(|record| record.stale)
}

/// Returns whether this many points can be relabelled from the votes.
///
/// The votes must be on these points, and at least one frame must have voted. Otherwise new masks
/// would not change any label, and the points have to be made again.
#[must_use]
pub fn can_revote(points: usize, votes: &Votes) -> bool {
    votes.len() == points && votes.frames().next().is_some()
}

/// Reads the votes on a cloud or mesh with this many points.
///
/// # Errors
///
/// Returns an error if the file is missing or damaged, or belongs to other points or frames.
/// Another program may have replaced one of the files.
pub fn read_votes_on(path: &Path, points: usize, frames: &[Frame]) -> Result<Votes> {
    let votes = read_votes_file(path)?;
    ensure!(
        votes.len() == points,
        "{}: has votes on {} points, but there are {points}; fuse again",
        path.display(),
        votes.len()
    );
    let unknown = votes.frames().find(|&frame| frame >= frames.len());
    if let Some(frame) = unknown {
        bail!(
            "{}: names frame {frame}, but the project has {} frames; fuse again",
            path.display(),
            frames.len()
        );
    }
    Ok(votes)
}

fn read_votes_file(path: &Path) -> Result<Votes> {
    let file = File::open(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    read_votes(BufReader::new(file))
        .with_context(|| format!("{}: is damaged; fuse again", path.display()))
}

/// Writes votes to a file atomically.
///
/// # Errors
///
/// Returns an error if the file cannot be written.
pub fn save_votes(path: &Path, votes: &Votes) -> Result<()> {
    let write = || -> std::io::Result<()> {
        let mut file = AtomicFile::create(path)?;
        let mut out = BufWriter::new(file.as_file());
        write_votes(&mut out, votes)?;
        out.flush()?;
        drop(out);
        file.commit()
    };
    write().with_context(|| {
        format!(
            "{}: cannot be written; check permissions and free space",
            path.display()
        )
    })
}

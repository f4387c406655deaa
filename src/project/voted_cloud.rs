//! The project's cloud with the votes behind its labels: its files, and its labels as the masks are now.

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

/// Frames that vote again with all of their masks decoded at once; of more, one mask is read after the other.
const FEW: usize = 8;

/// Why a file of a result is missing.
pub const NOT_KEPT: &str = "the result of this step is not kept any more; fuse again";

/// A labelled cloud and the votes behind its labels.
#[derive(Debug, Clone)]
pub struct VotedCloud {
    /// The points.
    pub cloud: Arc<LabelledCloud>,
    /// The votes on them.
    pub votes: Arc<Votes>,
}

impl VotedCloud {
    /// Reads a version of a project's cloud.
    ///
    /// # Errors
    /// When a file is missing or damaged, or the two do not belong together.
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

    /// Whether its points can be labelled again from the votes.
    #[must_use]
    pub fn can_revote(&self) -> bool {
        can_revote(self.cloud.len(), &self.votes)
    }

    /// With the labels of the masks now, for work that must not depend on whether a window let the cloud follow; as it is
    /// where it is not known who voted.
    ///
    /// # Errors
    /// As [`vote_again`].
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

    /// With the labels that the masks of the changed frames vote for now; `None` where that changes nothing.
    ///
    /// # Errors
    /// As [`vote_again`].
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

/// A mesh with the labels that the masks vote for now.
///
/// # Errors
/// As [`vote_again`].
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

/// Whether the project's cloud was made from inputs that changed since.
#[must_use]
pub fn is_stale(project: &Project) -> bool {
    project
        .results
        .get(&ResultKind::Cloud)
        .is_some_and(|record| record.stale)
}

/// Whether so many points can be labelled again from the votes: they are votes on these points, and frames are known
/// that see them. Without any, masks made since would change nothing, and the points have to be made again.
#[must_use]
pub fn can_revote(points: usize, votes: &Votes) -> bool {
    votes.len() == points && votes.frames().next().is_some()
}

/// Reads the votes on a cloud or mesh of so many points.
///
/// # Errors
/// When the file is missing or damaged, or belongs to other points or frames: a program may have replaced one of the files.
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

/// Writes votes to a file, whole or not at all.
///
/// # Errors
/// When the file cannot be written.
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

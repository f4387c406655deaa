use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

use anyhow::{Context, Result};
use sha2::{Digest, Sha256};

use crate::voted_cloud::read_votes_on;
use ostra_cloud::fuse::{Fused, ProjectViews, Votes, vote_again};
use ostra_cloud::ply::{read_mesh, read_ply};
use ostra_cloud::{LabelledCloud, LabelledMesh};
use ostra_core::job::Progress;
use ostra_frames::Frame;
use ostra_project::store::{cloud_path, mesh_path, mesh_votes_path, version_in_force, votes_path};
use ostra_project::{FuseRequest, Project, ResultKind, ResultRecord};

/// Number of the way in which points and surfaces are made; another number makes them again.
const FUSION: u32 = 2;

/// The project's cloud where it was made of the very frames, cameras, depths and options that it would be made of now:
/// points and vertices stay, and only masks vote again.
pub(super) struct VotedBefore {
    /// What is known of that cloud.
    pub(super) record: ResultRecord,
    root: PathBuf,
    /// The cloud and its votes, where they are in memory.
    loaded: Option<(Arc<LabelledCloud>, Arc<Votes>)>,
}

impl VotedBefore {
    /// `None` where points have to be made, or could come back that were left out.
    pub(super) fn find(
        project: &Project,
        root: &Path,
        request: &FuseRequest,
        geometry: &str,
        loaded: Option<(Arc<LabelledCloud>, Arc<Votes>)>,
    ) -> Option<Self> {
        let before = Self::in_force(project, root, loaded)?;
        let same = before.record.geometry.as_deref() == Some(geometry) && !request.drop_unlabelled;
        same.then_some(before)
    }

    /// The project's cloud whatever it was made of; `None` where there is none.
    pub(super) fn in_force(
        project: &Project,
        root: &Path,
        loaded: Option<(Arc<LabelledCloud>, Arc<Votes>)>,
    ) -> Option<Self> {
        version_in_force(project, ResultKind::Cloud)?;
        let record = project.results.get(&ResultKind::Cloud)?.clone();
        Some(Self {
            record,
            root: root.to_owned(),
            loaded,
        })
    }

    /// The cloud with its votes; `None` where it is not known who voted.
    ///
    /// # Errors
    /// When a file is damaged, or they do not belong together.
    pub(super) fn load(
        &self,
        frames: &[Frame],
        progress: &Progress,
    ) -> Result<Option<(Arc<LabelledCloud>, Arc<Votes>)>> {
        let (cloud, votes) = match &self.loaded {
            Some((cloud, votes)) => (Arc::clone(cloud), Arc::clone(votes)),
            None => {
                let version = self.record.version;
                let cloud = read_ply(&cloud_path(&self.root, version), progress)?.cloud;
                let votes = read_votes_on(&votes_path(&self.root, version), cloud.len(), frames)?;
                (Arc::new(cloud), Arc::new(votes))
            }
        };
        Ok(can_vote_again(&votes).then_some((cloud, votes)))
    }

    /// The cloud, voted on again; `None` where it is not known who voted, or its files cannot be used.
    pub(super) fn cloud(
        &self,
        views: &ProjectViews<'_>,
        project: &Project,
        progress: &Progress,
    ) -> Result<Option<Fused>> {
        let loaded = self.load(views.frames, progress);
        progress.check()?;
        // What cannot be read is made again by those who can.
        let Ok(Some((cloud, votes))) = loaded else {
            return Ok(None);
        };
        Ok(Some(vote_again(
            &cloud,
            &votes,
            views,
            &project.labels,
            progress,
        )?))
    }

    /// The surface with its votes, voted on anew; `None` where there is none, or it is not known who voted.
    pub(super) fn surface(
        &self,
        views: &ProjectViews<'_>,
        project: &Project,
        progress: &Progress,
    ) -> Result<Option<(LabelledMesh, Votes)>> {
        let version = self.record.version;
        if self.record.voxel.is_none() {
            return Ok(None);
        }
        let mesh = read_mesh(&mesh_path(&self.root, version), progress);
        progress.check()?;
        let Ok(mesh) = mesh else { return Ok(None) };
        let votes = read_votes_on(
            &mesh_votes_path(&self.root, version),
            mesh.vertices.len(),
            views.frames,
        )
        .ok();
        let Some(votes) = votes.filter(can_vote_again) else {
            return Ok(None);
        };
        let voted = vote_again(&mesh.vertices, &votes, views, &project.labels, progress)?;
        Ok(Some((
            LabelledMesh {
                vertices: voted.cloud,
                ..mesh
            },
            voted.votes,
        )))
    }
}

/// Whether frames are known that see the points.
fn can_vote_again(votes: &Votes) -> bool {
    votes.frames().next().is_some()
}

/// A digest of all that decides where points and vertices lie and which pixels see them: frames with their cameras and
/// depths, the files these are read from as they are now, the options, and the program.
pub(super) fn geometry_digest(project: &Project, request: &FuseRequest) -> Result<String> {
    let stamp = |path: &Path| {
        let meta = std::fs::metadata(path).ok()?;
        let since = meta
            .modified()
            .ok()?
            .duration_since(SystemTime::UNIX_EPOCH)
            .ok()?;
        Some((meta.len(), since.as_nanos()))
    };
    let of_frames = project.frames.iter().flat_map(|frame| {
        let depth = frame.depth.as_ref().and_then(|depth| depth.sensor_path());
        [stamp(frame.picture.path()), depth.and_then(stamp)]
    });
    let stamps: Vec<_> = of_frames
        .chain([request.onto.as_deref().and_then(stamp)])
        .collect();
    let all = (
        env!("CARGO_PKG_VERSION"),
        FUSION,
        &project.frames,
        request,
        stamps,
    );
    let bytes = serde_json::to_vec(&all).context("what the cloud is made of cannot be told")?;
    Ok(Sha256::digest(bytes)
        .iter()
        .map(|byte| format!("{byte:02x}"))
        .collect())
}

//! The votes behind the labels of the project's cloud.
//!
//! They show whether its points can be relabelled without making them again, and which mask they
//! give a frame.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

use anyhow::{Context, Result};
use sha2::{Digest, Sha256};

use crate::mask_edits::mask_of;
use crate::store::{cloud_path, mesh_path, mesh_votes_path, version_in_force, votes_path};
use crate::voted_cloud::{VotedCloud, can_revote, read_votes_on};
use crate::{FuseRequest, Project, ResultKind, ResultRecord};
use ostra_cloud::conflicts::{MaskedFrame, voted_mask};
use ostra_cloud::fuse::{Fused, ProjectViews, Votes, vote_again};
use ostra_cloud::ply::{read_mesh, read_ply};
use ostra_cloud::{LabelledCloud, LabelledMesh};
use ostra_core::job::Progress;
use ostra_frames::{DepthMap, Frame};
use ostra_masks::{LabelId, LabelMask};

/// Version of the method that makes points and surfaces. A cloud of another version is made again.
const FUSION: u32 = 2;

/// The votes on the project's cloud.
///
/// If the cloud was made from the current frames, cameras, depths and options, its points and
/// vertices are reused and only the masks vote again.
#[derive(Debug)]
pub struct ReusableVotes {
    /// Record of the cloud.
    pub record: ResultRecord,
    root: PathBuf,
    /// The cloud and its votes, if they are in memory.
    loaded: Option<VotedCloud>,
}

impl ReusableVotes {
    /// Returns the votes of the project's cloud if `request` would make the same points again.
    ///
    /// Returns `None` if it would make other points, or could bring back points that were left out.
    pub fn find(
        project: &Project,
        root: &Path,
        request: &FuseRequest,
        geometry: &str,
        loaded: Option<VotedCloud>,
    ) -> Option<Self> {
        let before = Self::in_force(project, root, loaded)?;
        let same = before.record.geometry.as_deref() == Some(geometry) && !request.drop_unlabelled;
        same.then_some(before)
    }

    /// Returns the votes of the project's cloud, or `None` if there is no cloud.
    ///
    /// The inputs of the cloud are not compared.
    pub fn in_force(project: &Project, root: &Path, loaded: Option<VotedCloud>) -> Option<Self> {
        version_in_force(project, ResultKind::Cloud)?;
        let record = project.results.get(&ResultKind::Cloud)?.clone();
        Some(Self {
            record,
            root: root.to_owned(),
            loaded,
        })
    }

    /// Returns the cloud with its votes, or `None` if the frames that voted are unknown.
    ///
    /// # Errors
    ///
    /// Returns an error if a file is damaged, or the files do not belong together.
    pub fn load(&self, frames: &[Frame], progress: &Progress) -> Result<Option<VotedCloud>> {
        let loaded = match &self.loaded {
            Some(loaded) => loaded.clone(),
            None => {
                let version = self.record.version;
                let cloud = read_ply(&cloud_path(&self.root, version), progress)?.cloud;
                let votes = read_votes_on(&votes_path(&self.root, version), cloud.len(), frames)?;
                VotedCloud {
                    cloud: Arc::new(cloud),
                    votes: Arc::new(votes),
                }
            }
        };
        Ok(can_revote(loaded.cloud.len(), &loaded.votes).then_some(loaded))
    }

    /// Relabels the points of the cloud.
    ///
    /// Returns `None` if the frames that voted are unknown or a file cannot be used.
    ///
    /// # Errors
    ///
    /// Returns an error if a mask does not fit its frame, or the progress is stopped.
    pub fn cloud(
        &self,
        views: &ProjectViews<'_>,
        project: &Project,
        progress: &Progress,
    ) -> Result<Option<Fused>> {
        let loaded = self.load(views.frames, progress);
        progress.check()?;
        // If the cloud cannot be read, the caller makes it from the depths.
        let Ok(Some(loaded)) = loaded else {
            return Ok(None);
        };
        Ok(Some(vote_again(
            &loaded.cloud,
            &loaded.votes,
            views,
            &project.labels,
            progress,
        )?))
    }

    /// Relabels the surface.
    ///
    /// Returns `None` if there is no surface or the frames that voted are unknown.
    ///
    /// # Errors
    ///
    /// Returns an error if a mask does not fit its frame, or the progress is stopped.
    pub fn surface(
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
        let Some(votes) = votes.filter(|votes| can_revote(mesh.vertices.len(), votes)) else {
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

/// The mask that the vote of all frames gives a frame, for some or all labels.
#[derive(Debug, Clone, Copy)]
pub struct MaskByVote<'a> {
    /// Cloud whose labels are projected.
    pub cloud: &'a LabelledCloud,
    /// Votes behind the labels.
    pub votes: &'a Votes,
    /// Frame number.
    pub frame: usize,
    /// Labels to project; empty means all.
    pub labels: &'a [LabelId],
}

impl MaskByVote<'_> {
    /// Projects the labels into the frame.
    ///
    /// The frame's depth, if there is one, determines what is occluded.
    ///
    /// # Errors
    ///
    /// Returns an error if the frame is missing, or its mask and the votes do not fit together.
    pub fn project(&self, project: &Project, depth: Option<&DepthMap>) -> Result<LabelMask> {
        let frame = project.frame(self.frame)?;
        let own = mask_of(project, self.frame)?;
        let masked = MaskedFrame {
            number: self.frame,
            frame,
            depth,
            mask: &own,
        };
        let mut mask = voted_mask(self.cloud, self.votes, &masked, self.labels)?;
        for (id, own) in mask.ids.iter_mut().zip(&own.ids) {
            // Labels that were removed since the vote are left out.
            if *id != LabelId::NONE && project.labels.get(*id).is_none() {
                *id = *own;
            }
        }
        Ok(mask)
    }
}

/// Returns a digest of everything that determines points, vertices and the pixels that see them.
///
/// It includes the frames with their cameras and depths, the current state of the files they are
/// read from, the options, and the program version.
///
/// # Errors
///
/// Returns an error if a value cannot be represented in JSON.
pub fn geometry_digest(project: &Project, request: &FuseRequest) -> Result<String> {
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
        [stamp(frame.image.path()), depth.and_then(stamp)]
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
    let bytes = serde_json::to_vec(&all).context("the inputs of the cloud are not recorded")?;
    Ok(Sha256::digest(bytes)
        .iter()
        .map(|byte| format!("{byte:02x}"))
        .collect())
}

#[cfg(test)]
mod tests;

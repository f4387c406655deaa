use anyhow::{Context, Result};

use super::cloud::{CloudState, Snapshot};
use crate::Event;
use crate::jobs::JobKind;
use crate::query::QueryKey;
use ostra_cloud::ply::read_mesh;
use ostra_cloud::{LabelledMesh, voxel_faces, voxelize};
use ostra_core::job::Progress;
use ostra_project::store::{mesh_path, mesh_votes_path};
use ostra_project::voted_cloud::{NOT_KEPT, read_votes_on, relabelled_mesh};

/// A surface of a result that can be drawn besides its points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SurfaceKind {
    /// The mesh, where every triangle has one label.
    Mesh,
    /// The outer faces of the voxels that contain points, at the voxel size of the mesh.
    Voxels,
}

/// The mesh of a version of the project's cloud, as it was made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct MeshKey {
    pub(crate) version: u64,
}

impl QueryKey for MeshKey {
    const TITLE: &'static str = "Load mesh";
    const EVENT: Option<Event> = Some(Event::CloudChanged);

    fn kind(&self) -> JobKind {
        JobKind::Short
    }
}

/// Reads the mesh.
///
/// # Errors
///
/// Returns an error if its file is missing or damaged.
pub(crate) fn load_mesh(
    snapshot: &Snapshot,
    key: &MeshKey,
    progress: &Progress,
) -> Result<LabelledMesh> {
    read_mesh(&mesh_path(&snapshot.root, key.version), progress).context(NOT_KEPT)
}

/// Triangles to draw, with the labels of a state of the cloud.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SurfaceKey {
    pub(crate) cloud: CloudState,
    pub(crate) surface: SurfaceKind,
    /// Voxel size in world units.
    pub(crate) voxel: f64,
}

impl QueryKey for SurfaceKey {
    const TITLE: &'static str = "Load surface";
    const EVENT: Option<Event> = Some(Event::CloudChanged);

    /// New labels of a surface that is already shown are computed in the background.
    fn kind(&self) -> JobKind {
        if self.cloud.round > 0 {
            JobKind::Background
        } else {
            JobKind::Short
        }
    }

    /// Labels of an earlier round of voting are shown until the new ones are ready.
    fn serves(&self, wanted: &Self) -> bool {
        self.cloud.version == wanted.cloud.version && self.surface == wanted.surface
    }
}

/// Makes the triangles.
///
/// # Errors
///
/// Returns an error if a file of the result is missing or damaged.
pub(crate) fn make_surface(
    snapshot: &Snapshot,
    key: &SurfaceKey,
    progress: &Progress,
) -> Result<LabelledMesh> {
    let Snapshot {
        project,
        root,
        store,
        ..
    } = snapshot;
    let version = key.cloud.version;
    match key.surface {
        SurfaceKind::Mesh => {
            let mesh = read_mesh(&mesh_path(root, version), progress).context(NOT_KEPT)?;
            let path = mesh_votes_path(root, version);
            let votes = read_votes_on(&path, mesh.vertices.len(), &project.frames);
            let mesh = match votes.ok().filter(|_| key.cloud.round > 0) {
                Some(votes) => relabelled_mesh(mesh, &votes, project, store, progress)?,
                None => mesh,
            };
            Ok(mesh.split_at_labels())
        }
        SurfaceKind::Voxels => {
            let voted = snapshot.voted_cloud(version, progress)?;
            let voxels = voxelize(&voted.cloud, Some(&voted.votes), key.voxel)?;
            Ok(voxel_faces(&voxels, key.voxel))
        }
    }
}

use std::sync::Arc;

use anyhow::{Context, Result};

use super::Session;
use super::cloud::{CloudState, read_votes_on};
use super::jobs::{Kind, Landing};
use super::on_demand::OnDemand;
use crate::Event;
use ostra_cloud::fuse::{ProjectViews, Votes, vote_again};
use ostra_cloud::ply::{read_mesh, read_ply};
use ostra_cloud::{LabelledCloud, LabelledMesh, voxel_faces, voxelize};
use ostra_core::job::JobId;
use ostra_core::job::Progress;
use ostra_frames::{Frame, FrameStore};
use ostra_project::store::{cloud_path, mesh_path, mesh_votes_path, version_in_force, votes_path};
use ostra_project::{Project, ResultKind};

/// What can be drawn of a result besides its points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Surface {
    /// The mesh, every triangle in one label.
    Mesh,
    /// The outer faces of the cubes that hold points, as large as those the mesh was made with.
    Voxels,
}

/// What was loaded last: the mesh as it was made, and triangles to be drawn.
#[derive(Default)]
pub(super) struct Surfaces {
    mesh: OnDemand<u64, LabelledMesh>,
    drawn: OnDemand<(CloudState, Surface), LabelledMesh>,
    /// What makes something to be drawn: one at a time.
    drawing: Option<JobId>,
}

impl Session {
    /// Edge of the voxels of the surface that was made with the project's cloud, world units; `None` where there is no
    /// cloud, or it has none (a cloud that was given).
    #[must_use]
    pub fn surface_voxel(&self) -> Option<f64> {
        self.project()?.results.get(&ResultKind::Cloud)?.voxel
    }

    /// The surface that was made with the project's cloud. As [`Self::cloud`] it is loaded by a job when it is first asked
    /// for: `None` until [`Event::CloudChanged`].
    #[must_use]
    pub fn mesh(&self) -> Option<&Arc<LabelledMesh>> {
        self.surfaces.mesh.get(self.version_with_surface()?)
    }

    /// Triangles of the project's result to be drawn, labelled as the cloud in memory is. Made by a job as [`Self::mesh`] is
    /// loaded; those of the round of voting before stand until then.
    #[must_use]
    pub fn surface(&self, surface: Surface) -> Option<&Arc<LabelledMesh>> {
        self.surface_voxel()?;
        let state = self.cloud_state()?;
        self.surfaces.drawn.get_or((state, surface), |(of, kind)| {
            of.version == state.version && kind == surface
        })
    }

    fn version_with_surface(&self) -> Option<u64> {
        self.surface_voxel()?;
        version_in_force(self.project()?, ResultKind::Cloud)
    }

    /// Starts to load or make what was asked for.
    pub(super) fn load_wanted_surfaces(&mut self) {
        let Some(root) = self.root().map(std::path::Path::to_owned) else {
            return;
        };
        if let Some(version) = self.surfaces.mesh.next_wanted() {
            let path = mesh_path(&root, version);
            self.start("Load mesh", Kind::Short, move |link| {
                let mesh = Arc::new(read_mesh(&path, &link.progress).context(NOT_KEPT)?);
                Ok(Box::new(move |session: &mut Self| {
                    session.surfaces.mesh.put(version, mesh);
                    session.events.push(Event::CloudChanged);
                    Ok(())
                }) as Landing)
            });
        }
        let is_drawing = |id| self.jobs.iter().any(|job| job.id == id && !job.has_ended());
        if self.surfaces.drawing.is_some_and(is_drawing) {
            return;
        }
        let Some((state, surface)) = self.surfaces.drawn.next_wanted() else {
            return;
        };
        let (Some(voxel), Ok(project)) = (self.surface_voxel(), self.snapshot()) else {
            return;
        };
        let (version, store) = (state.version, Arc::clone(&self.store));
        let loaded = self.cloud.in_force(Some(version));
        // New labels of what is seen already come of themselves.
        let kind = if state.round > 0 {
            Kind::Background
        } else {
            Kind::Short
        };
        self.surfaces.drawing = Some(self.start("Load surface", kind, move |link| {
            let drawn = match surface {
                Surface::Mesh => {
                    let mesh =
                        read_mesh(&mesh_path(&root, version), &link.progress).context(NOT_KEPT)?;
                    let path = mesh_votes_path(&root, version);
                    let votes = read_votes_on(&path, mesh.vertices.len(), &project.frames);
                    let votes = votes.ok().filter(|_| state.round > 0);
                    match votes {
                        Some(votes) => {
                            voted_again(mesh, &votes, (&project, &store), &link.progress)?
                                .split_at_labels()
                        }
                        None => mesh.split_at_labels(),
                    }
                }
                Surface::Voxels => {
                    let (cloud, votes) = match loaded {
                        Some(loaded) => loaded,
                        None => load_cloud(&root, version, &project.frames, &link.progress)?,
                    };
                    voxel_faces(&voxelize(&cloud, Some(&votes), voxel)?, voxel)
                }
            };
            Ok(Box::new(move |session: &mut Self| {
                session
                    .surfaces
                    .drawn
                    .put((state, surface), Arc::new(drawn));
                session.events.push(Event::CloudChanged);
                Ok(())
            }) as Landing)
        }));
    }
}

const NOT_KEPT: &str = "the result of this step is not kept any more; fuse again";

/// The mesh as the masks vote now.
fn voted_again(
    mesh: LabelledMesh,
    votes: &Votes,
    (project, store): (&Project, &FrameStore),
    progress: &Progress,
) -> Result<LabelledMesh> {
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

/// The cloud of a version with its votes, from the disk.
pub(super) fn load_cloud(
    root: &std::path::Path,
    version: u64,
    frames: &[Frame],
    progress: &Progress,
) -> Result<(Arc<LabelledCloud>, Arc<Votes>)> {
    let cloud = read_ply(&cloud_path(root, version), progress)
        .context(NOT_KEPT)?
        .cloud;
    let votes = read_votes_on(&votes_path(root, version), cloud.len(), frames)?;
    Ok((Arc::new(cloud), Arc::new(votes)))
}

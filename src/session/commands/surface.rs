use std::path::Path;
use std::sync::Arc;

use anyhow::Result;

use ostra_cloud::fuse::{
    Coverage, MaskVote, OntoOptions, ProjectViews, SeenPoints, Votes, vote_seen,
};
use ostra_cloud::ply::{SavedColors, save_mesh};
use ostra_cloud::volume::{VolumeOptions, reconstruct_surface};
use ostra_cloud::{LabelledMesh, SceneError};
use ostra_core::job::Progress;
use ostra_frames::{Frame, FrameStore};
use ostra_masks::LabelId;
use ostra_project::reusable_votes::ReusableVotes;
use ostra_project::store::{DepthFolder, mesh_path, mesh_votes_path, version_in_force};
use ostra_project::voted_cloud::save_votes;
use ostra_project::{FuseRequest, Project, ResultKind};

/// Memory for the voxels of a surface whose voxel size is not given.
const DEFAULT_BYTES: usize = 256 << 20;
/// Voxel blocks per block-sized cell that a surface crosses.
///
/// Blocks within the truncation distance belong to the surface too.
const BLOCKS_PER_CELL: f64 = 2.0;
/// Factor for the voxel size if a surface still needs more than twice that memory.
const COARSER: f64 = 1.5;

/// Inputs of a fusion: of its surface and of its points.
pub(super) struct FusionInputs<'a> {
    pub(super) store: &'a FrameStore,
    pub(super) root: &'a Path,
    pub(super) project: &'a Project,
    pub(super) request: &'a FuseRequest,
}

/// A surface that was made, or why there is none.
pub(super) enum Made {
    /// A surface with this voxel size.
    Surface { voxel: f64 },
    /// No surface; the reason is given if a surface was to be expected.
    Nothing(Option<String>),
}

impl FusionInputs<'_> {
    /// Makes the surface from the frames' depths, labels its vertices by vote, and saves it.
    ///
    /// # Errors
    ///
    /// Returns an error if a frame cannot be read, the file cannot be written, or the progress is
    /// stopped.
    pub(super) fn make_surface(
        &self,
        version: u64,
        before: Option<&ReusableVotes>,
        progress: &Progress,
    ) -> Result<Made> {
        if self.request.onto.is_some() {
            return Ok(Made::Nothing(None));
        }
        let masks = |frame: usize| {
            self.project
                .mask_in_play(frame)
                .map(|runs| Arc::new(runs.decode()))
        };
        let views = ProjectViews {
            frames: &self.project.frames,
            store: self.store,
            masks: &masks,
        };
        if let Some(before) = before
            && let Some((mesh, votes)) = before.surface(&views, self.project, progress)?
        {
            save_surface(self.root, version, &mesh, &votes, progress)?;
            return Ok(before
                .record
                .voxel
                .map_or(Made::Nothing(None), |voxel| Made::Surface { voxel }));
        }
        let Some(voxel) = self.voxel(&views, progress)? else {
            return Ok(Made::Nothing(None));
        };
        let kind = if stereo_version(self.project).is_some() {
            VolumeOptions::for_stereo()
        } else {
            VolumeOptions::default()
        };
        let max_bytes = if self.request.voxel.is_some() {
            kind.max_bytes
        } else {
            2 * DEFAULT_BYTES
        };
        let mut options = VolumeOptions {
            voxel,
            only_labelled: self.request.drop_unlabelled,
            max_bytes,
            ..kind
        };
        let surface = loop {
            match reconstruct_surface(&views, &options, progress) {
                // A size that was not requested may be increased, because it was chosen from a few
                // frames.
                Err(SceneError::TooLarge { .. }) if self.request.voxel.is_none() => {
                    options.voxel *= COARSER;
                }
                Err(error @ (SceneError::TooLarge { .. } | SceneError::Request(_))) => {
                    return Ok(Made::Nothing(Some(format!("no surface was made: {error}"))));
                }
                made => break made?,
            }
        };
        if surface.mesh.triangles.is_empty() {
            return Ok(Made::Nothing(Some(
                "no surface was made: the depths contain none at this voxel size".into(),
            )));
        }
        let (mut mesh, votes) = self.vote(surface.mesh, &views, progress)?;
        mesh.vertices.origin = self.project.origin;
        save_surface(self.root, version, &mesh, &votes, progress)?;
        Ok(Made::Surface {
            voxel: options.voxel,
        })
    }

    /// Returns the voxel size of the surface.
    ///
    /// It is the requested size. Otherwise it is the size that a pixel of the depth maps covers, or
    /// more if that would need too much memory.
    fn voxel(&self, views: &ProjectViews<'_>, progress: &Progress) -> Result<Option<f64>> {
        if self.request.voxel.is_some() {
            return Ok(self.request.voxel);
        }
        let frames = &self.project.frames;
        let usable: Vec<usize> = (0..frames.len())
            .filter(|&frame| {
                frames[frame].posed_camera().is_some() && frames[frame].depth.is_some()
            })
            .collect();
        progress.stage("surface")?;
        let only_labelled = self.request.drop_unlabelled;
        let Some(coverage) = Coverage::measure(views, &usable, only_labelled, progress)? else {
            return Ok(None);
        };
        let (edge, bytes) = VolumeOptions::BLOCK;
        let blocks = DEFAULT_BYTES as f64 / (bytes as f64 * BLOCKS_PER_CELL);
        let proportionate = coverage.edge_for(blocks) / f64::from(edge);
        let Some(version) = stereo_version(self.project) else {
            return Ok(Some(coverage.footprint.max(proportionate)));
        };
        let max_side = DepthFolder::new(self.root, version, frames)
            .load_account()?
            .max_side;
        let side = usable
            .iter()
            .map(|&frame| frames[frame].width.max(frames[frame].height))
            .max()
            .unwrap_or(max_side);
        let measured =
            coverage.footprint * f64::from(side.max(max_side)) / f64::from(max_side.max(1));
        Ok(Some(measured.max(proportionate)))
    }

    fn vote(
        &self,
        mesh: LabelledMesh,
        views: &ProjectViews<'_>,
        progress: &Progress,
    ) -> Result<(LabelledMesh, Votes)> {
        let min_confidence = self.request.min_confidence.unwrap_or(0.0);
        let onto = OntoOptions {
            min_confidence,
            ..OntoOptions::default()
        };
        let vote = MaskVote {
            views,
            tree: &self.project.labels,
            options: &onto,
        };
        let voted = vote_seen(mesh.vertices, &SeenPoints::new(), &vote, progress)?;
        let mesh = LabelledMesh {
            vertices: voted.cloud,
            triangles: mesh.triangles,
        };
        if !self.request.drop_unlabelled {
            return Ok((mesh, voted.votes));
        }
        let is_labelled = |vertex: &u32| mesh.vertices.labels[*vertex as usize] != LabelId::NONE;
        let (labelled, kept) = mesh.filter(|at| mesh.triangles[at].iter().all(is_labelled));
        Ok((labelled, voted.votes.select(&kept)))
    }
}

/// Saves a surface and the votes on its vertices, so that they can vote again.
pub(super) fn save_surface(
    root: &Path,
    version: u64,
    mesh: &LabelledMesh,
    votes: &Votes,
    progress: &Progress,
) -> Result<()> {
    save_mesh(
        &mesh_path(root, version),
        mesh,
        SavedColors::Image,
        progress,
    )?;
    save_votes(&mesh_votes_path(root, version), votes)
}

/// Returns the version of the depth maps if stereo made all depths of the project.
pub(super) fn stereo_version(project: &Project) -> Option<u64> {
    let measured = project.frames.iter().any(Frame::has_sensor_depth);
    let made = project.frames.iter().any(|frame| frame.depth.is_some());
    version_in_force(project, ResultKind::Depths).filter(|_| made && !measured)
}

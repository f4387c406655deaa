use std::path::Path;

use anyhow::{Context, Result};

use super::export::Sources;
use crate::engine::job::Progress;
use crate::scene::ply::{Coloring, label_paths, read_mesh, save_mesh, twin_path};
use crate::scene::{LabelledCloud, voxelize};
use crate::session::ExportRequest;

/// Writes the surface that was made with the cloud, under the label names of today: every triangle in one label.
pub(super) fn write_mesh(path: &Path, sources: &Sources, request: &ExportRequest, progress: &Progress) -> Result<()> {
    let (file, _) = sources.surface.as_ref().context("the cloud has no surface")?;
    let mut mesh = read_mesh(file, progress).context("the project's mesh is gone; fuse again")?;
    progress.stage("write mesh")?;
    super::make_folder_of(path)?;
    mesh.vertices.tree = sources.tree_of_today(&mesh.vertices.tree);
    if let Some(level) = request.level {
        mesh.vertices = mesh.vertices.at_level(level);
    }
    let mesh = mesh.split_at_labels();
    save_mesh(path, &mesh, Coloring::Picture, progress)?;
    if request.twin {
        save_mesh(&twin_path(path), &mesh, Coloring::Labels, progress)?;
    }
    if request.per_label {
        for (id, file) in label_paths(path, &mesh.vertices) {
            let part = mesh.filter(|at| mesh.vertices.labels[mesh.triangles[at][0] as usize] == id);
            save_mesh(&file, &part, Coloring::Picture, progress)?;
        }
    }
    Ok(())
}

/// The cubes that hold points of the cloud, as large as the voxels of its surface.
pub(super) fn voxels(cloud: &LabelledCloud, sources: &Sources) -> Result<LabelledCloud> {
    let (_, voxel) = sources.surface.as_ref().context("the cloud has no surface")?;
    Ok(voxelize(cloud, sources.votes()?.as_ref(), *voxel)?)
}

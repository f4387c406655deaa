//! Export of clouds, meshes, voxels and trait tables.

use std::path::Path;

use anyhow::{Context, Result};

use super::export_inputs::{Sources, make_folder_of};
use ostra_cloud::formats::{CloudFormat, MeshFormat, VoxelFormat, save_origin};
use ostra_cloud::fuse::ProjectViews;
use ostra_cloud::measure::{LengthUnit, MeasureOptions, measure, measure_angles, traits_csv};
use ostra_cloud::ply::{Coloring, label_paths, read_mesh, save_per_label, twin_path};
use ostra_cloud::{LabelledCloud, LabelledMesh, SceneError, fill_interior, voxelize};
use ostra_core::job::Progress;
use ostra_project::ExportRequest;
use ostra_project::store::replace;

/// Writes the cloud.
pub(super) fn write_cloud(
    path: &Path,
    cloud: &LabelledCloud,
    request: &ExportRequest,
    progress: &Progress,
) -> Result<()> {
    progress.stage("write cloud")?;
    let format = CloudFormat::of(path)?;
    let save =
        |path: &Path, cloud: &LabelledCloud, coloring| format.save(path, cloud, coloring, progress);
    write_points(path, cloud, request, save)?;
    Ok(CloudFormat::save_classes(path, cloud)?)
}

/// Writes the surface that was made with the cloud, with the current label names.
///
/// Every triangle has one label. Returns a warning if more triangles remain than requested, and a
/// note about the origin of the positions.
pub(super) fn write_mesh(
    path: &Path,
    sources: &Sources,
    request: &ExportRequest,
    progress: &Progress,
) -> Result<Vec<String>> {
    let format = MeshFormat::of(path)?;
    let (file, _) = sources
        .surface
        .as_ref()
        .context("the cloud has no surface; fuse frames with depth to get one")?;
    let mut mesh = read_mesh(file, progress).context("the project's mesh is gone; fuse again")?;
    mesh.vertices.tree = sources.tree_of_today(&mesh.vertices.tree);
    if let Some(level) = request.level {
        mesh.vertices = mesh.vertices.at_level(level);
    }
    let whole = mesh.split_at_labels();
    let simple = request
        .simplify
        .map(|share| simplified(&whole, share, progress))
        .transpose()?;
    let (mesh, warning) = simple.unwrap_or((whole, None));
    progress.stage("write mesh")?;
    make_folder_of(path)?;
    format.save(path, &mesh, Coloring::Image, progress)?;
    if request.twin {
        format.save(&twin_path(path), &mesh, Coloring::Labels, progress)?;
    }
    if request.per_label {
        let files = label_paths(path, &mesh.vertices);
        for (id, part) in mesh.by_label() {
            format.save(&files[&id], &part, Coloring::Image, progress)?;
        }
    }
    Ok(warning
        .into_iter()
        .chain(save_origin(path, mesh.vertices.origin)?)
        .collect())
}

/// Simplifies a mesh to a share of its triangles.
///
/// Also returns a warning if clearly more triangles remain.
fn simplified(
    whole: &LabelledMesh,
    share: f64,
    progress: &Progress,
) -> Result<(LabelledMesh, Option<String>)> {
    /// Factor by which the share may be exceeded without a warning.
    const SLACK: f64 = 1.05;
    progress.stage("simplify mesh")?;
    let mesh = whole.simplify(share, progress)?;
    let (before, after) = (whole.triangles.len(), mesh.triangles.len());
    let missed = after as f64 > (before as f64 * share * SLACK).max(1.0);
    let warning = format!(
        "the mesh keeps {after} of its {before} triangles: with fewer, borders of labels and holes would move"
    );
    Ok((mesh, missed.then_some(warning)))
}

/// Writes the voxels that contain points of the cloud, at the voxel size of its surface.
pub(super) fn write_voxels(
    path: &Path,
    cloud: &LabelledCloud,
    sources: &Sources,
    request: &ExportRequest,
    progress: &Progress,
) -> Result<()> {
    let format = VoxelFormat::of(path)?;
    let (mesh, voxel) = sources
        .surface
        .as_ref()
        .context("the cloud has no surface; fuse frames with depth to get one")?;
    progress.stage("write voxels")?;
    let mut voxels = voxelize(cloud, sources.votes(cloud.len())?.as_deref(), *voxel)?;
    if request.solid {
        let surface =
            read_mesh(mesh, progress).context("the project's mesh is gone; fuse again")?;
        let views = ProjectViews {
            frames: &sources.project.frames,
            store: &sources.store,
            masks: &|_| None,
        };
        voxels = fill_interior(&voxels, *voxel, &surface, &views, progress)?;
    }
    let request = ExportRequest {
        twin: request.twin && format.has_twin(),
        ..request.clone()
    };
    let save = |path: &Path, voxels: &LabelledCloud, coloring| {
        format.save(path, voxels, *voxel, coloring, progress)
    };
    write_points(path, &voxels, &request, save)
}

/// Writes a cloud or voxels with `save`, at the requested level.
///
/// Then writes the copy in label colours and the parts, if requested.
fn write_points(
    path: &Path,
    cloud: &LabelledCloud,
    request: &ExportRequest,
    save: impl Fn(&Path, &LabelledCloud, Coloring) -> Result<(), SceneError>,
) -> Result<()> {
    make_folder_of(path)?;
    let coarse = request.level.map(|level| cloud.at_level(level));
    let cloud = coarse.as_ref().unwrap_or(cloud);
    save(path, cloud, Coloring::Image)?;
    if request.twin {
        save(&twin_path(path), cloud, Coloring::Labels)?;
    }
    if request.per_label {
        save_per_label(path, cloud, |path, part| save(path, part, Coloring::Image))?;
    }
    Ok(())
}

/// Measures every label of a cloud and the requested angles, and writes the table.
///
/// Lengths are in the requested unit, or in the scene's unit if none is requested.
pub(super) fn write_traits(
    path: &Path,
    cloud: &LabelledCloud,
    request: &ExportRequest,
    of_scene: LengthUnit,
    progress: &Progress,
) -> Result<()> {
    let options = MeasureOptions {
        level: request.level,
        ground: request.ground,
        ..MeasureOptions::default()
    };
    let mut rows = measure(cloud, &options, progress)?;
    rows.extend(measure_angles(cloud, &request.angles, &options, progress)?);
    make_folder_of(path)?;
    replace(
        path,
        traits_csv(&rows, request.unit.unwrap_or(of_scene)).as_bytes(),
    )
}

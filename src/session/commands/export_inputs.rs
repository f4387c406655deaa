//! Inputs of an export, and the checks and warnings about them.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};

use crate::ExportedItem;
use ostra_cloud::LabelledCloud;
use ostra_cloud::formats::{CloudFormat, MeshFormat, VoxelFormat, origin_path};
use ostra_cloud::fuse::Votes;
use ostra_cloud::measure::LengthUnit;
use ostra_cloud::ply::{label_paths, twin_path};
use ostra_frames::{Frame, FrameStore};
use ostra_masks::{Label, LabelId, LabelTree};
use ostra_project::export_targets::ExportTargets;
use ostra_project::voted_cloud::read_votes_on;
use ostra_project::{ExportRequest, Project};

/// Snapshots of the inputs of an export.
pub struct ExportInputs {
    pub(super) project: Arc<Project>,
    pub(super) store: Arc<FrameStore>,
    /// The labelled cloud, if it is in memory.
    pub(super) cloud: Option<Arc<LabelledCloud>>,
    pub(super) cloud_votes: Option<Arc<Votes>>,
    pub(super) cloud_file: Option<PathBuf>,
    /// Folder of the project; `None` for an inspected PLY.
    pub(super) root: Option<PathBuf>,
    /// Path of the surface that was made with the cloud, and its voxel size.
    pub(super) surface: Option<(PathBuf, f64)>,
    pub(super) votes_file: Option<PathBuf>,
    /// Unit of lengths in the cloud and its surface.
    pub(super) unit: LengthUnit,
    /// Whether an input of the cloud has changed since.
    pub(super) is_stale: bool,
    /// Whether the labels of the cloud in memory are those of the current masks.
    pub(super) follows: bool,
}

impl ExportInputs {
    /// Returns the project's label tree, with the labels that were removed since a result was made.
    pub(super) fn tree_of_today(&self, former: &LabelTree) -> LabelTree {
        let mut tree = self.project.labels.clone();
        for label in former
            .iter()
            .filter(|label| self.project.labels.get(label.id).is_none())
        {
            let _ = tree.set(Label {
                parent: None,
                ..label.clone()
            });
        }
        tree
    }

    /// Returns the votes on a cloud with this many points; `None` for an inspected PLY.
    pub(super) fn votes(&self, points: usize) -> Result<Option<Arc<Votes>>> {
        let of = |path: &Path| read_votes_on(path, points, &self.project.frames);
        let read = || self.votes_file.as_deref().map(of).transpose();
        if self.cloud_votes.is_some() {
            Ok(self.cloud_votes.clone())
        } else {
            Ok(read()?.map(Arc::new))
        }
    }
}

pub(super) fn check(request: &ExportRequest, inputs: &ExportInputs) -> Result<()> {
    let ExportRequest {
        cloud,
        mesh,
        voxels,
        cameras,
        undistorted,
        masks,
        depths,
        traits,
        ..
    } = request;
    let anything = [
        cloud,
        mesh,
        voxels,
        cameras,
        undistorted,
        masks,
        depths,
        traits,
    ]
    .into_iter()
    .any(Option::is_some);
    ensure!(
        anything,
        "nothing to export; choose a cloud, mesh, voxels, cameras, masks, depths or traits"
    );
    let has_cloud = inputs.cloud.is_some() || inputs.cloud_file.is_some();
    let of_cloud = [cloud, mesh, voxels, traits]
        .into_iter()
        .any(Option::is_some);
    ensure!(
        has_cloud || !of_cloud,
        "the project has no cloud yet; fuse first"
    );
    cloud.as_deref().map(CloudFormat::of).transpose()?;
    mesh.as_deref().map(MeshFormat::of).transpose()?;
    voxels.as_deref().map(VoxelFormat::of).transpose()?;
    ensure!(
        (mesh.is_none() && voxels.is_none()) || inputs.surface.is_some(),
        "this cloud has no surface; fuse the project's depths (not onto a given cloud)"
    );
    let frames = &inputs.project.frames;
    ensure!(
        (cameras.is_none() && undistorted.is_none())
            || frames.iter().any(|frame| frame.posed_camera().is_some()),
        "no frame has a camera with a pose; give cameras or reconstruct first"
    );
    ensure!(
        depths.is_none() || frames.iter().any(|frame| frame.depth.is_some()),
        "no frame has depth; give depth images first"
    );
    check_unit(request, inputs)?;
    ensure!(
        request.level != Some(0),
        "levels count from 1, the top level"
    );
    Ok(())
}

/// Rejects metric lengths of a cloud whose scale is unknown.
///
/// For an inspected PLY, the user is expected to know the unit.
pub(super) fn check_unit(request: &ExportRequest, inputs: &ExportInputs) -> Result<()> {
    let is_known = inputs.unit != LengthUnit::World || inputs.root.is_none();
    let Some(unit) = request
        .unit
        .filter(|&unit| unit != LengthUnit::World && !is_known)
    else {
        return Ok(());
    };
    let scaled = inputs.project.coordinates().unit != LengthUnit::World;
    let what = match scaled {
        true => "the cloud is older than the scale of the cameras; fuse again",
        false => {
            "set it by a known length ('ostra scale', or the ruler of the 3-D view), or leave the unit out"
        }
    };
    bail!(
        "traits cannot be given in {}, the scale of the cloud is not known: {what}",
        unit.sign()
    )
}

pub(super) fn first_renamed<'a>(
    before: &'a [Frame],
    after: &'a [Frame],
) -> Option<(&'a str, &'a str)> {
    before
        .iter()
        .zip(after)
        .map(|(before, after)| (&*before.name, &*after.name))
        .find(|(before, after)| before != after)
}

pub(super) fn output_folders(request: &ExportRequest) -> impl Iterator<Item = &Path> {
    [
        &request.cameras,
        &request.undistorted,
        &request.masks,
        &request.depths,
    ]
    .into_iter()
    .flatten()
    .map(PathBuf::as_path)
}

/// Returns all files that an export may write outside its folders.
///
/// With `per_label`, this includes one file for each label of `tree`.
pub(super) fn output_files(request: &ExportRequest, tree: &LabelTree) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for path in [&request.cloud, &request.mesh, &request.voxels]
        .into_iter()
        .flatten()
    {
        files.push(origin_path(path));
        let mut of_path = vec![path.clone()];
        if request.twin {
            of_path.push(twin_path(path));
        }
        if request.per_label {
            of_path.extend(label_paths(path, &every_label(tree)).into_values());
        }
        let materials: Vec<PathBuf> = of_path
            .iter()
            .filter_map(|file| MeshFormat::materials_path(file))
            .collect();
        files.extend(of_path.into_iter().chain(materials));
    }
    files.extend(request.cloud.as_deref().map(CloudFormat::classes_path));
    files.extend(request.traits.clone());
    files
}

/// Returns the files and folders that exist after an export, with their sizes.
///
/// What cannot be read is left out, because the export itself has succeeded.
pub(super) fn exported_items(files: &[PathBuf], folders: &[PathBuf]) -> Vec<ExportedItem> {
    let file = |path: &PathBuf| {
        let bytes = std::fs::metadata(path).ok()?.len();
        Some(ExportedItem {
            path: path.clone(),
            files: None,
            bytes,
        })
    };
    let folder = |path: &PathBuf| {
        let (count, bytes) = size_of(path).ok()?;
        Some(ExportedItem {
            path: path.clone(),
            files: Some(count),
            bytes,
        })
    };
    let files = files.iter().filter_map(file);
    files.chain(folders.iter().filter_map(folder)).collect()
}

/// Returns the number and the total size of the files in a folder.
fn size_of(folder: &Path) -> std::io::Result<(usize, u64)> {
    let (mut count, mut bytes) = (0, 0);
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let kind = entry.file_type()?;
        let is_hidden = entry.file_name().as_encoded_bytes().starts_with(b".");
        if kind.is_dir() {
            let (more, of_them) = size_of(&entry.path())?;
            (count, bytes) = (count + more, bytes + of_them);
        } else if kind.is_file() && !is_hidden {
            (count, bytes) = (count + 1, bytes + entry.metadata()?.len());
        }
    }
    Ok((count, bytes))
}

/// Returns a cloud with one point for each label and one unlabelled point.
pub(super) fn every_label(tree: &LabelTree) -> LabelledCloud {
    let labels: Vec<LabelId> = std::iter::once(LabelId::NONE)
        .chain(tree.iter().map(|label| label.id))
        .collect();
    let places = LabelledCloud::from_positions(vec![glam::Vec3::ZERO; labels.len()]);
    LabelledCloud {
        labels,
        tree: tree.clone(),
        ..places
    }
}

/// Rejects targets that an export must not write to, before anything is written.
pub(super) fn check_targets(request: &ExportRequest, targets: &ExportTargets) -> Result<()> {
    let without_labels = ExportRequest {
        per_label: false,
        ..request.clone()
    };
    let files = output_files(&without_labels, &LabelTree::default());
    targets.check_files(files.iter().map(PathBuf::as_path))?;
    let folders: Vec<&Path> = output_folders(request).collect();
    for (at, folder) in folders.iter().enumerate() {
        targets.check_folder(folder)?;
        if let Some(other) = folders[..at]
            .iter()
            .find(|other| folder.starts_with(other) || other.starts_with(folder))
        {
            bail!(
                "{} and {} would share a folder; give each kind of result a folder of its own",
                other.display(),
                folder.display()
            );
        }
    }
    Ok(())
}

/// Returns a warning if an input of the exported points or triangles has changed since.
pub(super) fn outdated(request: &ExportRequest, inputs: &ExportInputs) -> Option<String> {
    if !inputs.is_stale {
        return None;
    }
    let of_points = [&request.cloud, &request.voxels, &request.traits]
        .into_iter()
        .any(Option::is_some);
    let mut reported = Vec::new();
    if of_points && inputs.follows {
        reported.push("labels are up to date, but the points are from the last fusion");
    } else if of_points {
        reported.push("the cloud is written as it was fused");
    }
    if request.mesh.is_some() {
        reported.push("the mesh is written as it was fused");
    }
    let text = || {
        format!(
            "out of date: {}; cameras, depths or masks changed after that. Fuse again before exporting",
            reported.join(", ")
        )
    };
    (!reported.is_empty()).then(text)
}

/// Creates the folder of a file that is to be written.
pub fn make_folder_of(file: &Path) -> Result<()> {
    let Some(folder) = file
        .parent()
        .filter(|folder| !folder.as_os_str().is_empty())
    else {
        return Ok(());
    };
    std::fs::create_dir_all(folder)
        .with_context(|| format!("{}: cannot be made; check permissions", folder.display()))
}

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};

use crate::Session;
use crate::cloud::read_votes_on;
use crate::{Kind, Landing};
use ostra_cloud::LabelledCloud;
use ostra_cloud::formats::{CloudFormat, MeshFormat, VoxelFormat, origin_path, save_origin};
use ostra_cloud::fuse::Votes;
use ostra_cloud::measure::LengthUnit;
use ostra_cloud::ply::{label_paths, read_ply, twin_path};
use ostra_core::job::JobId;
use ostra_core::job::Progress;
use ostra_frames::cameras::{ModelEncoding, SparsePoints, with_text_names, write_colmap_model};
use ostra_frames::{Frame, FrameStore};
use ostra_masks::{Label, LabelId, LabelTree, MaskFormat};
use ostra_project::export_targets::ExportTargets;
use ostra_project::store::{cloud_path, read_sparse, version_in_force, votes_path};
use ostra_project::{ExportRequest, Project, ResultKind};

/// What an export reads: snapshots.
pub(super) struct Sources {
    pub(super) project: Arc<Project>,
    pub(super) store: Arc<FrameStore>,
    /// The labelled cloud in memory, or where it lies.
    cloud: Option<Arc<LabelledCloud>>,
    cloud_votes: Option<Arc<Votes>>,
    cloud_file: Option<PathBuf>,
    /// The project's folder; `None` for a PLY that is inspected.
    root: Option<PathBuf>,
    /// Where the surface lies that was made with the cloud, and the edge of its voxels.
    pub(super) surface: Option<(PathBuf, f64)>,
    votes_file: Option<PathBuf>,
    /// Of lengths in the cloud and its surface.
    unit: LengthUnit,
    /// What the cloud was made of has changed since.
    is_stale: bool,
    /// The labels of the cloud in memory are those of the masks now.
    follows: bool,
}

impl Session {
    pub(crate) fn export(&mut self, request: &ExportRequest) -> Result<JobId> {
        let sources = self.export_sources()?;
        check(request, &sources)?;
        let targets =
            ExportTargets::of(&sources.project, sources.root.as_deref(), request.overwrite);
        check_targets(request, &targets)?;
        let request = request.clone();
        Ok(self.start("Export", Kind::Short, move |link| {
            let warnings = write(&request, &sources, &targets, &link.progress)?;
            Ok(Box::new(move |session: &mut Self| {
                session.warn_all(warnings);
                Ok(())
            }) as Landing)
        }))
    }

    /// A PLY that is inspected alone can be exported too: its cloud is all there is.
    fn export_sources(&self) -> Result<Sources> {
        let inspecting = self.inspected.is_some();
        let project = if inspecting {
            Arc::default()
        } else {
            self.snapshot()?
        };
        let version = version_in_force(&project, ResultKind::Cloud);
        let root = self.root().map(Path::to_owned);
        let cloud_file = version.and_then(|version| Some(cloud_path(root.as_deref()?, version)));
        let votes_file = version.and_then(|version| Some(votes_path(root.as_deref()?, version)));
        let store = Arc::clone(&self.store);
        let (cloud, cloud_votes) = (self.cloud().cloned(), self.votes().cloned());
        let surface = self.surface_file();
        let unit = if inspecting {
            LengthUnit::World
        } else {
            project.cloud_unit()
        };
        let is_stale = project
            .results
            .get(&ResultKind::Cloud)
            .is_some_and(|record| record.stale);
        let follows = is_stale && self.follows();
        Ok(Sources {
            is_stale,
            follows,
            project,
            store,
            cloud,
            cloud_votes,
            cloud_file,
            votes_file,
            root,
            surface,
            unit,
        })
    }
}

fn check(request: &ExportRequest, sources: &Sources) -> Result<()> {
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
        "nothing to export was named; choose a cloud, mesh, voxels, cameras, masks, depths or traits"
    );
    let has_cloud = sources.cloud.is_some() || sources.cloud_file.is_some();
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
        (mesh.is_none() && voxels.is_none()) || sources.surface.is_some(),
        "this cloud has no surface; fuse the project's depths (not onto a given cloud)"
    );
    let frames = &sources.project.frames;
    ensure!(
        (cameras.is_none() && undistorted.is_none())
            || frames.iter().any(|frame| frame.posed_camera().is_some()),
        "no frame has a camera with a pose; give cameras or reconstruct first"
    );
    ensure!(
        depths.is_none() || frames.iter().any(|frame| frame.depth.is_some()),
        "no frame has depth; give depth pictures first"
    );
    mask_format(request)?;
    check_unit(request, sources)?;
    ensure!(
        request.level != Some(0),
        "levels count from 1, the top level"
    );
    Ok(())
}

/// Refuses metric lengths of a cloud whose scale is not known. Of a PLY that is inspected alone the user knows the unit.
fn check_unit(request: &ExportRequest, sources: &Sources) -> Result<()> {
    let is_known = sources.unit != LengthUnit::World || sources.root.is_none();
    let Some(unit) = request
        .unit
        .filter(|&unit| unit != LengthUnit::World && !is_known)
    else {
        return Ok(());
    };
    let scaled = sources.project.coordinates().unit != LengthUnit::World;
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

/// Writes what was asked for; returns what the user should know.
fn write(
    request: &ExportRequest,
    sources: &Sources,
    targets: &ExportTargets,
    progress: &Progress,
) -> Result<Vec<String>> {
    let of_cloud = request.cloud.is_some() || request.voxels.is_some() || request.traits.is_some();
    let cloud = (of_cloud || request.per_label)
        .then(|| load_cloud(sources, progress))
        .transpose()?;
    // A cloud may have labels that the project has no longer; they get files too.
    let labels = cloud.as_ref().map_or_else(LabelTree::default, |cloud| {
        sources.tree_of_today(&cloud.tree)
    });
    let files = output_files(request, &labels);
    if request.per_label {
        targets.check_files(files.iter().map(PathBuf::as_path))?;
    }
    let folders: Vec<PathBuf> = output_folders(request).map(Path::to_owned).collect();
    let write = || write_targets(request, sources, cloud.as_ref(), progress);
    let (mut warnings, removed) = ExportTargets::write_all(&files, &folders, write)?;
    warnings.extend(removed);
    Ok(warnings)
}

fn write_targets(
    request: &ExportRequest,
    sources: &Sources,
    cloud: Option<&LabelledCloud>,
    progress: &Progress,
) -> Result<Vec<String>> {
    let mut warnings: Vec<String> = outdated(request, sources).into_iter().collect();
    if let Some(cloud) = cloud {
        if let Some(path) = &request.cloud {
            write_cloud(path, cloud, request, progress)?;
            warnings.extend(save_origin(path, cloud.origin)?);
            warnings.extend(without_points(cloud, request.level).filter(|_| request.per_label));
        }
        let voxels = |path| super::models::write_voxels(path, cloud, sources, request, progress);
        request.voxels.as_deref().map_or(Ok(()), voxels)?;
        if let Some(path) = &request.voxels {
            warnings.extend(save_origin(path, cloud.origin)?);
        }
        let traits = |path| super::traits::write(path, cloud, request, sources.unit, progress);
        request.traits.as_deref().map_or(Ok(()), traits)?;
    }
    if let Some(path) = &request.mesh {
        warnings.extend(super::models::write_mesh(path, sources, request, progress)?);
    }
    let of_project = |root| read_sparse(root, &sources.project);
    let sparse = || -> Result<SparsePoints> {
        let points = sources
            .root
            .as_deref()
            .map_or_else(|| Ok(SparsePoints::default()), of_project)?;
        Ok(sources.project.global_points(points))
    };
    if let Some(folder) = &request.cameras {
        let frames = &sources.project.global_frames();
        let renamed = match request.camera_encoding {
            ModelEncoding::Text => with_text_names(frames),
            ModelEncoding::Binary => None,
        };
        if let Some((before, after)) = renamed
            .as_deref()
            .and_then(|renamed| first_renamed(frames, renamed))
        {
            warnings.push(format!(
                "{}: COLMAP's text format ends names at a space, so '{before}' and the like are written as '{after}'; \
                 give --binary to keep the names",
                folder.display()
            ));
        }
        write_colmap_model(
            folder,
            renamed.as_deref().unwrap_or(frames),
            &sparse()?,
            request.camera_encoding,
        )?;
    }
    if let Some(folder) = &request.undistorted {
        warnings.extend(super::undistorted::write(
            folder,
            &sources.project,
            &sparse()?,
            &sources.store,
            progress,
        )?);
    }
    if let Some(folder) = &request.masks {
        super::masks::write(
            folder,
            mask_format(request)?,
            &sources.project,
            request.level,
            progress,
        )?;
    }
    if let Some(folder) = &request.depths {
        warnings.extend(super::depths::write(
            folder,
            &sources.project,
            &sources.store,
            progress,
        )?);
    }
    Ok(warnings)
}

fn first_renamed<'a>(before: &'a [Frame], after: &'a [Frame]) -> Option<(&'a str, &'a str)> {
    before
        .iter()
        .zip(after)
        .map(|(before, after)| (&*before.name, &*after.name))
        .find(|(before, after)| before != after)
}

fn output_folders(request: &ExportRequest) -> impl Iterator<Item = &Path> {
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

/// All files that an export may write besides those in folders; with `per_label` one for each label of `tree`.
fn output_files(request: &ExportRequest, tree: &LabelTree) -> Vec<PathBuf> {
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

/// A cloud with a point of each label and one without.
fn every_label(tree: &LabelTree) -> LabelledCloud {
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

/// Refuses places that an export must not write to, before anything is written.
fn check_targets(request: &ExportRequest, targets: &ExportTargets) -> Result<()> {
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

/// A warning where the points or triangles were made of something that has changed since.
fn outdated(request: &ExportRequest, sources: &Sources) -> Option<String> {
    if !sources.is_stale {
        return None;
    }
    let of_points = [&request.cloud, &request.voxels, &request.traits]
        .into_iter()
        .any(Option::is_some);
    let mut told = Vec::new();
    if of_points && sources.follows {
        told.push("the cloud has the labels of now but the points that were fused");
    } else if of_points {
        told.push("the cloud is written as it was fused");
    }
    if request.mesh.is_some() {
        told.push("the mesh is written as it was fused");
    }
    let text = || {
        format!(
            "{}, and something that it was made from has changed since; fuse again",
            told.join(", ")
        )
    };
    (!told.is_empty()).then(text)
}

fn mask_format(request: &ExportRequest) -> Result<MaskFormat> {
    Ok(request
        .mask_format
        .as_deref()
        .map(str::parse)
        .transpose()?
        .unwrap_or_default())
}

/// The cloud, under the label names of today.
fn load_cloud(sources: &Sources, progress: &Progress) -> Result<LabelledCloud> {
    let mut cloud = match (&sources.cloud, &sources.cloud_file) {
        (Some(cloud), _) => LabelledCloud::clone(cloud),
        (None, Some(path)) => {
            read_ply(path, progress)
                .context("the project's cloud is gone; fuse again")?
                .cloud
        }
        (None, None) => bail!("there is no cloud"),
    };
    if sources.cloud_file.is_some() {
        cloud.tree = sources.tree_of_today(&cloud.tree);
    }
    Ok(cloud)
}

impl Sources {
    /// The project's labels; those taken out since a result was made keep their former names in it.
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

    /// How the cloud of so many points was voted on; `None` for a PLY that is inspected.
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

fn write_cloud(
    path: &Path,
    cloud: &LabelledCloud,
    request: &ExportRequest,
    progress: &Progress,
) -> Result<()> {
    progress.stage("write cloud")?;
    let format = CloudFormat::of(path)?;
    let save =
        |path: &Path, cloud: &LabelledCloud, coloring| format.save(path, cloud, coloring, progress);
    super::models::write_points(path, cloud, request, save)?;
    Ok(CloudFormat::save_classes(path, cloud)?)
}

/// A warning where labels get no file of their own.
fn without_points(cloud: &LabelledCloud, level: Option<usize>) -> Option<String> {
    let coarse = level.map(|level| cloud.at_level(level));
    let labels: BTreeSet<LabelId> = coarse
        .as_ref()
        .unwrap_or(cloud)
        .labels
        .iter()
        .copied()
        .collect();
    let tree = &cloud.tree;
    let wanted = |label: &Label| match level {
        Some(level) => tree.depth(label.id) == level,
        None => !tree.iter().any(|other| other.parent == Some(label.id)),
    };
    let missing: Vec<&str> = tree
        .iter()
        .filter(|l| wanted(l) && !labels.contains(&l.id))
        .map(|label| label.name.as_str())
        .collect();
    (!missing.is_empty()).then(|| {
        format!(
            "these labels have no points and get no file: {}",
            missing.join(", ")
        )
    })
}

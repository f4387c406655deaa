use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, bail};

use super::export_frames::{write_depths, write_undistorted};
use super::export_inputs::{
    ExportInputs, check, check_targets, exported_items, first_renamed, outdated, output_files,
    output_folders,
};
use super::export_scene::{write_cloud, write_mesh, write_traits, write_voxels};
use crate::Session;
use crate::{Event, ExportedItem};
use crate::{JobCompletion, JobKind};
use ostra_cloud::LabelledCloud;
use ostra_cloud::formats::save_origin;
use ostra_cloud::measure::LengthUnit;
use ostra_cloud::ply::read_ply;
use ostra_core::job::{JobId, PlannedStage, Progress};
use ostra_frames::cameras::{ModelEncoding, SparsePoints, with_text_names, write_colmap_model};
use ostra_frames::{Image, TurntableOptions, write_turntable};
use ostra_masks::{Label, LabelId, LabelTree};
use ostra_project::export_targets::ExportTargets;
use ostra_project::store::{cloud_path, mesh_path, read_sparse, version_in_force, votes_path};
use ostra_project::{ExportRequest, ResultKind};

impl Session {
    pub(crate) fn export(&mut self, request: &ExportRequest) -> Result<JobId> {
        let inputs = self.export_inputs()?;
        check(request, &inputs)?;
        let targets = ExportTargets::of(&inputs.project, inputs.root.as_deref(), request.overwrite);
        check_targets(request, &targets)?;
        let request = request.clone();
        Ok(self.start("Export", JobKind::Short, move |context| {
            context.progress.plan(&planned_stages(&request));
            let written = write(&request, &inputs, &targets, &context.progress)?;
            Ok(Box::new(move |session: &mut Self| {
                session.warn_all(written.warnings);
                session.events.push(Event::Exported(written.items));
                Ok(())
            }) as JobCompletion)
        }))
    }

    /// Checks that an export may write a file.
    ///
    /// # Errors
    ///
    /// Returns an error if the file is a source, lies inside a project, or was not written by
    /// OSTRA. The one-line message names the file, the reason, and what to do.
    pub fn check_export(&self, file: &Path, overwrite: bool) -> Result<()> {
        let project = self.project().map(Arc::clone).unwrap_or_default();
        ExportTargets::of(&project, self.root(), overwrite).check_files([file])
    }

    /// Writes an image with `write` on a worker thread.
    ///
    /// Drawing is passed in as a closure because this crate cannot draw, and the crate that can has
    /// no jobs.
    ///
    /// # Errors
    ///
    /// Returns the errors of [`Self::check_export`].
    pub fn write_image(
        &mut self,
        path: &Path,
        overwrite: bool,
        write: impl FnOnce(&Path) -> Result<()> + Send + 'static,
    ) -> Result<JobId> {
        self.check_export(path, overwrite)?;
        let path = path.to_owned();
        Ok(self.start("Save image", JobKind::Short, move |context| {
            context.progress.stage("draw")?;
            ExportTargets::write_files(std::slice::from_ref(&path), || write(&path))?;
            Ok(Box::new(move |session: &mut Self| {
                session.events.push(Event::Notice(format!(
                    "image written to {}",
                    path.display()
                )));
                Ok(())
            }) as JobCompletion)
        }))
    }

    /// Writes a video on a worker thread, like [`Self::write_image`].
    ///
    /// `draw` returns the image with the given number.
    ///
    /// # Errors
    ///
    /// Returns the errors of [`Self::check_export`].
    pub fn write_turntable(
        &mut self,
        path: &Path,
        options: TurntableOptions,
        overwrite: bool,
        draw: impl Fn(usize) -> Image + Send + 'static,
    ) -> Result<JobId> {
        self.check_export(path, overwrite)?;
        let path = path.to_owned();
        Ok(self.start("Save video", JobKind::Short, move |context| {
            context.progress.stage("write video")?;
            let write = || Ok(write_turntable(&path, &options, draw, &context.progress)?);
            ExportTargets::write_files(std::slice::from_ref(&path), write)?;
            Ok(Box::new(move |session: &mut Self| {
                session.events.push(Event::Notice(format!(
                    "video written to {}",
                    path.display()
                )));
                Ok(())
            }) as JobCompletion)
        }))
    }

    /// Collects the inputs of an export.
    ///
    /// An inspected PLY can be exported too; it has only a cloud.
    fn export_inputs(&self) -> Result<ExportInputs> {
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
        let surface = self
            .surface_voxel()
            .zip(version)
            .and_then(|(voxel, version)| Some((mesh_path(root.as_deref()?, version), voxel)));
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
        Ok(ExportInputs {
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

/// Returns the stages of an export, in the order of [`write_targets`].
fn planned_stages(request: &ExportRequest) -> Vec<PlannedStage> {
    let stage = PlannedStage::new;
    let all = [
        (
            request.cloud.is_some(),
            stage("write cloud", "Write cloud", 2.0),
        ),
        (
            request.voxels.is_some(),
            stage("write voxels", "Write voxels", 2.0),
        ),
        (
            request.traits.is_some(),
            stage("measure", "Measure traits", 4.0),
        ),
        (
            request.mesh.is_some() && request.simplify.is_some(),
            stage("simplify mesh", "Simplify mesh", 4.0),
        ),
        (
            request.mesh.is_some(),
            stage("write mesh", "Write mesh", 2.0),
        ),
        (
            request.undistorted.is_some(),
            stage("write undistorted images", "Write undistorted images", 4.0),
        ),
        (
            request.masks.is_some(),
            stage("export masks", "Write masks", 2.0),
        ),
        (
            request.depths.is_some(),
            stage("write depths", "Write depth maps", 3.0),
        ),
    ];
    let wanted = all.into_iter().filter(|(is_wanted, _)| *is_wanted);
    wanted.map(|(_, stage)| stage).collect()
}

/// What an export wrote, and warnings for the user.
struct Written {
    items: Vec<ExportedItem>,
    warnings: Vec<String>,
}

/// Writes the requested files.
fn write(
    request: &ExportRequest,
    inputs: &ExportInputs,
    targets: &ExportTargets,
    progress: &Progress,
) -> Result<Written> {
    let of_cloud = request.cloud.is_some() || request.voxels.is_some() || request.traits.is_some();
    let cloud = (of_cloud || request.per_label)
        .then(|| load_cloud(inputs, progress))
        .transpose()?;
    // A cloud may have labels that the project no longer has. They get files too.
    let labels = cloud.as_ref().map_or_else(LabelTree::default, |cloud| {
        inputs.tree_of_today(&cloud.tree)
    });
    let files = output_files(request, &labels);
    if request.per_label {
        targets.check_files(files.iter().map(PathBuf::as_path))?;
    }
    let folders: Vec<PathBuf> = output_folders(request).map(Path::to_owned).collect();
    let write = || write_targets(request, inputs, cloud.as_ref(), progress);
    let (mut warnings, removed) = ExportTargets::write_all(&files, &folders, write)?;
    warnings.extend(removed);
    let items = exported_items(&files, &folders);
    Ok(Written { items, warnings })
}

/// Warning for traits in a unit that nothing confirms.
const UNIT_ASSUMED: &str = "traits are in metres only if the given cameras are; a model made from photos alone (as by \
     COLMAP) has no unit: set the scale first";

fn write_targets(
    request: &ExportRequest,
    inputs: &ExportInputs,
    cloud: Option<&LabelledCloud>,
    progress: &Progress,
) -> Result<Vec<String>> {
    let mut warnings: Vec<String> = outdated(request, inputs).into_iter().collect();
    if request.traits.is_some() && inputs.project.is_unit_assumed() {
        warnings.push(UNIT_ASSUMED.to_owned());
    }
    if let Some(cloud) = cloud {
        if let Some(path) = &request.cloud {
            write_cloud(path, cloud, request, progress)?;
            warnings.extend(save_origin(path, cloud.origin)?);
            warnings.extend(without_points(cloud, request.level).filter(|_| request.per_label));
        }
        let voxels = |path| write_voxels(path, cloud, inputs, request, progress);
        request.voxels.as_deref().map_or(Ok(()), voxels)?;
        if let Some(path) = &request.voxels {
            warnings.extend(save_origin(path, cloud.origin)?);
        }
        let traits = |path| write_traits(path, cloud, request, inputs.unit, progress);
        request.traits.as_deref().map_or(Ok(()), traits)?;
    }
    if let Some(path) = &request.mesh {
        warnings.extend(write_mesh(path, inputs, request, progress)?);
    }
    let of_project = |root| read_sparse(root, &inputs.project);
    let sparse = || -> Result<SparsePoints> {
        let points = inputs
            .root
            .as_deref()
            .map_or_else(|| Ok(SparsePoints::default()), of_project)?;
        Ok(inputs.project.global_points(points))
    };
    if let Some(folder) = &request.cameras {
        let frames = &inputs.project.global_frames();
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
        warnings.extend(write_undistorted(
            folder,
            &inputs.project,
            &sparse()?,
            &inputs.store,
            progress,
        )?);
    }
    if let Some(folder) = &request.masks {
        super::masks::write(
            folder,
            request.mask_format.unwrap_or_default(),
            &inputs.project,
            request.level,
            progress,
        )?;
    }
    if let Some(folder) = &request.depths {
        warnings.extend(write_depths(
            folder,
            &inputs.project,
            &inputs.store,
            progress,
        )?);
    }
    Ok(warnings)
}

/// Returns the cloud with the current label names.
fn load_cloud(inputs: &ExportInputs, progress: &Progress) -> Result<LabelledCloud> {
    let mut cloud = match (&inputs.cloud, &inputs.cloud_file) {
        (Some(cloud), _) => LabelledCloud::clone(cloud),
        (None, Some(path)) => {
            read_ply(path, progress)
                .context("the project's cloud is gone; fuse again")?
                .cloud
        }
        (None, None) => bail!("there is no cloud; fuse first"),
    };
    if inputs.cloud_file.is_some() {
        cloud.tree = inputs.tree_of_today(&cloud.tree);
    }
    Ok(cloud)
}

/// Returns a warning about labels that get no file of their own.
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

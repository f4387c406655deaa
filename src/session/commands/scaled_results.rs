use ostra_project::ResultEngine;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use anyhow::{Context, Result};
use rayon::prelude::*;

use ostra_cloud::LabelledCloud;
use ostra_cloud::fuse::Votes;
use ostra_cloud::measure::LengthUnit;
use ostra_cloud::ply::{SavedColors, read_mesh, read_ply, save_mesh, save_ply};
use ostra_core::job::Progress;
use ostra_frames::cameras::{ModelEncoding, read_sparse_model, write_colmap_model};
use ostra_frames::{DepthSource, EstimatedDepth, Frame};
use ostra_project::reusable_votes::geometry_digest;
use ostra_project::store::{
    DepthFolder, DepthRunRecord, ModelCameras, cloud_path, depth_map_path, keep_votes, load_links,
    load_outcomes, mesh_path, replace, save_cameras, save_links, save_outcomes, sparse_path,
    sync_folder, version_in_force, votes_path,
};
use ostra_project::voted_cloud::read_votes_on;
use ostra_project::{
    Coordinates, Edit, FrameMask, FuseRequest, MaskOrigin, Project, ResultKind, ResultRecord,
};

/// Inputs for scaling a project: the factor, and the number of the files for the scaled results.
pub(super) struct Scaling {
    pub(super) project: Arc<Project>,
    pub(super) root: PathBuf,
    pub(super) factor: f64,
    pub(super) version: u64,
}

/// Scaled results, already written to disk.
pub(super) struct ScaledResults {
    /// Frames with their scaled cameras and depths.
    frames: Vec<Frame>,
    /// Whether depth maps of stereo were written.
    has_depths: bool,
    /// The cloud with its surface, if there is one that belongs to the cameras.
    pub(super) cloud: Option<ScaledCloud>,
    pub(super) warnings: Vec<String>,
}

/// A scaled cloud, with values for its record.
pub(super) struct ScaledCloud {
    pub(super) cloud: LabelledCloud,
    pub(super) votes: Option<Votes>,
    /// Factor by which its lengths were multiplied.
    factor: f64,
    geometry: Option<String>,
}

impl Scaling {
    /// Writes every result that has files under the new number, without changing the project.
    ///
    /// # Errors
    ///
    /// Returns an error if a file of a result is missing or damaged, a file cannot be written, or
    /// the progress is stopped.
    pub(super) fn write(&self, progress: &Progress) -> Result<ScaledResults> {
        let mut frames: Vec<Frame> = self
            .project
            .frames
            .iter()
            .map(|frame| self.frame(frame))
            .collect();
        self.write_sparse(&frames)?;
        let mut warnings = Vec::new();
        let has_depths = self.write_depths(&mut frames, &mut warnings, progress)?;
        let cloud = self.write_cloud(&frames, &mut warnings, progress)?;
        sync_folder(&self.root.join("versions"))?;
        Ok(ScaledResults {
            frames,
            has_depths,
            cloud,
            warnings,
        })
    }

    fn frame(&self, frame: &Frame) -> Frame {
        let mut frame = frame.clone();
        if let Some(pose) = frame
            .camera
            .as_mut()
            .and_then(|camera| camera.camera_from_world.as_mut())
        {
            pose.translation *= self.factor;
        }
        if let Some(DepthSource::Estimated { made, scale }) = &mut frame.depth {
            (*made, *scale) = (depth_map_path(self.version, &frame.name), 1.0);
        }
        frame
    }

    fn write_sparse(&self, frames: &[Frame]) -> Result<()> {
        let Some(before) = version_in_force(&self.project, ResultKind::Cameras) else {
            return Ok(());
        };
        let (source, folder) = (
            sparse_path(&self.root, before),
            sparse_path(&self.root, self.version),
        );
        let mut sparse = read_sparse_model(&source, &self.project.frames)
            .context("the sparse points cannot be scaled; reconstruct again, then set the scale")?;
        sparse
            .points
            .iter_mut()
            .for_each(|point| point.position *= self.factor);
        write_colmap_model(&folder, frames, &sparse, ModelEncoding::Text)?;
        save_outcomes(&folder, &load_outcomes(&source)?)?;
        let is_one_of_several = (self.project.results.get(&ResultKind::Cameras))
            .is_some_and(|record| !record.models.is_empty());
        if is_one_of_several {
            let posed = frames.iter().enumerate();
            let cameras = ModelCameras {
                origin: self.project.origin * self.factor,
                cameras: posed
                    .filter_map(|(number, frame)| Some((number, frame.camera?)))
                    .collect(),
            };
            save_cameras(&folder, &cameras)?;
        }
        save_links(&folder, &load_links(&source)?)
    }

    /// Writes scaled copies of the stereo depth maps, and returns whether there are any.
    ///
    /// Frames of `scaled` whose map cannot be read lose it, with a warning.
    fn write_depths(
        &self,
        scaled: &mut [Frame],
        warnings: &mut Vec<String>,
        progress: &Progress,
    ) -> Result<bool> {
        let frames = &self.project.frames;
        let maps: Vec<(usize, &PathBuf, f64)> = frames
            .iter()
            .enumerate()
            .filter_map(|(number, frame)| match &frame.depth {
                Some(DepthSource::Estimated { made, scale }) => Some((number, made, *scale)),
                _ => None,
            })
            .collect();
        if maps.is_empty() {
            return Ok(false);
        }
        progress.stage("scale depths")?;
        let done = AtomicUsize::new(0);
        let scale_map =
            |&(number, made, scale): &(usize, &PathBuf, f64)| -> Result<Option<(usize, String)>> {
                progress.step(done.fetch_add(1, Ordering::Relaxed), maps.len())?;
                let mut map = match EstimatedDepth::read(&self.root.join(made)) {
                    Ok(map) => map,
                    Err(error) => return Ok(Some((number, error.to_string()))),
                };
                let factor = scale * self.factor;
                map.depth
                    .depths
                    .iter_mut()
                    .for_each(|depth| *depth = (f64::from(*depth) * factor) as f32);
                let name = &frames[number].name;
                let bytes = map
                    .encode()
                    .with_context(|| format!("the depth of {name} cannot be scaled"))?;
                replace(&self.root.join(depth_map_path(self.version, name)), &bytes)?;
                Ok(None)
            };
        let unreadable: Vec<(usize, String)> = maps
            .par_iter()
            .filter_map(|map| scale_map(map).transpose())
            .collect::<Result<_>>()?;
        if let Some((_, first)) = unreadable.first() {
            let count = unreadable.len();
            warnings.push(format!(
                "{count} depth maps cannot be read and were taken off their frames ({first})"
            ));
        }
        unreadable
            .iter()
            .for_each(|&(number, _)| scaled[number].depth = None);
        if let Some(before) = version_in_force(&self.project, ResultKind::Depths) {
            let account = DepthFolder::new(&self.root, before, frames).load_account()?;
            // No run resumes from these depth maps, because they are complete.
            let account = DepthRunRecord {
                key: format!("{} times {}", account.key, self.factor),
                ..account
            };
            DepthFolder::new(&self.root, self.version, frames).save_account(&account)?;
        }
        Ok(true)
    }

    /// Writes the scaled cloud with its votes and surface.
    ///
    /// Returns `None` if there is no cloud that belongs to the cameras.
    fn write_cloud(
        &self,
        frames: &[Frame],
        warnings: &mut Vec<String>,
        progress: &Progress,
    ) -> Result<Option<ScaledCloud>> {
        let (project, root) = (&*self.project, &*self.root);
        let Some(before) = version_in_force(project, ResultKind::Cloud) else {
            return Ok(None);
        };
        let Some(factor) = self.cloud_factor() else {
            warnings
                .push("the cloud was made with other cameras and keeps its size, without a unit; fuse again".into());
            return Ok(None);
        };
        progress.stage("scale cloud")?;
        let mut cloud = read_ply(&cloud_path(root, before), progress)
            .context("the cloud cannot be scaled; fuse again, then set the scale")?
            .cloud;
        cloud.scale_by(factor);
        save_ply(
            &cloud_path(root, self.version),
            &cloud,
            SavedColors::Image,
            progress,
        )?;
        keep_votes(root, before, self.version)?;
        let record = project.results.get(&ResultKind::Cloud);
        if record.is_some_and(|record| record.voxel.is_some()) {
            progress.stage("scale mesh")?;
            let mut mesh = read_mesh(&mesh_path(root, before), progress)
                .context("the surface cannot be scaled; fuse again, then set the scale")?;
            mesh.vertices.scale_by(factor);
            save_mesh(
                &mesh_path(root, self.version),
                &mesh,
                SavedColors::Image,
                progress,
            )?;
        }
        let votes = read_votes_on(&votes_path(root, self.version), cloud.len(), frames).ok();
        let geometry = record.map_or(Ok(None), |record| self.geometry(record, frames, factor))?;
        Ok(Some(ScaledCloud {
            cloud,
            votes,
            factor,
            geometry,
        }))
    }

    /// Returns the factor that scales the cloud to the new size of the cameras.
    ///
    /// Returns `None` if the cloud and the cameras have different coordinates, or if the project
    /// has sensor depth.
    fn cloud_factor(&self) -> Option<f64> {
        let (now, cloud) = (
            self.project.coordinates(),
            self.project.cloud_coordinates()?,
        );
        let same = if cloud.scale == now.scale {
            self.factor
        } else {
            self.factor * now.scale / cloud.scale
        };
        let has_sensor = self.project.frames.iter().any(Frame::has_sensor_depth);
        (cloud.world == now.world && !has_sensor).then_some(same)
    }

    /// Returns the geometry digest of the scaled cloud.
    ///
    /// Returns `None` if the inputs of the cloud had already changed before scaling.
    fn geometry(
        &self,
        record: &ResultRecord,
        frames: &[Frame],
        factor: f64,
    ) -> Result<Option<String>> {
        let Some(request) = &record.request else {
            return Ok(None);
        };
        if record.geometry.as_ref() != Some(&geometry_digest(&self.project, request)?) {
            return Ok(None);
        }
        let scaled = Project {
            frames: Arc::new(frames.to_vec()),
            ..Project::default()
        };
        geometry_digest(&scaled, &scaled_request(request, factor)).map(Some)
    }
}

impl ScaledResults {
    /// Returns the edits that apply the scaled results to the project.
    ///
    /// The project must still have the same frames and files. Nothing becomes stale, because the
    /// results still fit each other.
    pub fn edits(&self, scaling: &Scaling, now: &Project) -> Vec<Edit> {
        let numbered = || self.frames.iter().enumerate();
        let origin = now.origin * scaling.factor;
        let mut edits: Vec<Edit> = if origin == now.origin {
            Vec::new()
        } else {
            vec![Edit::SetOrigin { origin }]
        };
        edits.extend(numbered().map(|(frame, scaled)| Edit::SetCamera {
            frame,
            camera: scaled.camera,
        }));
        let had_made = |number: usize| {
            matches!(
                now.frames[number].depth,
                Some(DepthSource::Estimated { .. })
            )
        };
        let made = numbered().filter(|&(number, _)| had_made(number));
        edits.extend(made.map(|(frame, scaled)| Edit::SetDepth {
            frame,
            depth: scaled.depth.clone(),
        }));
        let is_fresh = |mask: &FrameMask| mask.origin == MaskOrigin::Tracked && !mask.stale;
        let fresh = now
            .masks
            .iter()
            .filter(|(_, mask)| is_fresh(mask))
            .map(|(&frame, _)| frame)
            .collect();
        edits.push(Edit::SetStale {
            frames: fresh,
            stale: false,
        });
        let records = self.records(scaling, now).into_iter();
        edits.extend(records.map(|(kind, record)| Edit::SetResult {
            kind,
            record: Some(record),
        }));
        edits
    }

    fn records(&self, scaling: &Scaling, now: &Project) -> BTreeMap<ResultKind, ResultRecord> {
        let mut records = now.results.clone();
        let coordinates = now.coordinates().scaled_by(scaling.factor);
        let posed = self
            .frames
            .iter()
            .filter(|frame| frame.posed_camera().is_some())
            .count();
        let given = || ResultRecord {
            engine: ResultEngine::Given,
            frames: posed,
            ..ResultRecord::default()
        };
        let cameras = records.entry(ResultKind::Cameras).or_insert_with(given);
        let version = if cameras.version > 0 {
            scaling.version
        } else {
            0
        };
        *cameras = scaled_record(cameras, scaling.factor, version)
            .with_coordinates(cameras.version, coordinates);
        if let Some(depths) = records
            .get_mut(&ResultKind::Depths)
            .filter(|_| self.has_depths)
        {
            let version = if depths.version > 0 {
                scaling.version
            } else {
                0
            };
            *depths = scaled_record(depths, scaling.factor, version);
        }
        if let Some(record) = records.get_mut(&ResultKind::Cloud) {
            *record = match &self.cloud {
                Some(cloud) => scaled_cloud_record(record, cloud, coordinates, scaling.version),
                None => unscaled_cloud_record(record, now),
            };
        }
        records
    }

    /// Returns the message about the scale, which names what was scaled.
    pub(super) fn notice(&self, scaling: &Scaling) -> String {
        let mut what = vec!["cameras"];
        what.extend(self.has_depths.then_some("depths"));
        what.extend(self.cloud.is_some().then_some("cloud"));
        let (what, factor) = (what.join(", "), scaling.factor);
        let set = if scaling.project.coordinates().unit == LengthUnit::World {
            format!("1 unit = {} m", significant(factor))
        } else {
            format!("1 m of before = {} m", significant(factor))
        };
        format!("Scale set: {set} ({what} were scaled by {factor:.6}; lengths are in metres)")
    }
}

/// Formats a factor with four significant digits.
fn significant(factor: f64) -> String {
    let decimals = (3 - factor.abs().log10().floor() as i32).clamp(0, 15) as usize;
    let text = format!("{factor:.decimals$}");
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

fn scaled_request(request: &FuseRequest, factor: f64) -> FuseRequest {
    FuseRequest {
        voxel: request.voxel.map(|voxel| voxel * factor),
        ..request.clone()
    }
}

fn scaled_record(record: &ResultRecord, factor: f64, version: u64) -> ResultRecord {
    let before = if record.settings.is_empty() {
        String::new()
    } else {
        format!("{}, ", record.settings)
    };
    ResultRecord {
        settings: format!("{before}scaled by {factor:.6}"),
        scaled: Some(record.scaled.unwrap_or(1.0) * factor),
        version,
        ..record.clone()
    }
}

fn scaled_cloud_record(
    record: &ResultRecord,
    cloud: &ScaledCloud,
    coordinates: Coordinates,
    version: u64,
) -> ResultRecord {
    ResultRecord {
        voxel: record.voxel.map(|voxel| voxel * cloud.factor),
        geometry: cloud.geometry.clone(),
        coordinates: Some(coordinates),
        request: record
            .request
            .as_ref()
            .map(|request| scaled_request(request, cloud.factor)),
        ..scaled_record(record, cloud.factor, version)
    }
}

/// Returns the record of a cloud that keeps its size.
///
/// The cloud is stale, and has no unit unless it had its own coordinates.
fn unscaled_cloud_record(record: &ResultRecord, now: &Project) -> ResultRecord {
    // No result has this number as its world, so no later result shares these coordinates.
    let unknown = Coordinates {
        world: record.version,
        scale: 1.0,
        unit: LengthUnit::World,
    };
    let coordinates = now
        .cloud_coordinates()
        .filter(|cloud| cloud.world != now.coordinates().world);
    ResultRecord {
        stale: true,
        coordinates: Some(coordinates.unwrap_or(unknown)),
        ..record.clone()
    }
}

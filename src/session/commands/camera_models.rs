//! The models that the images fall into: all are saved, and any of them can be used.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result};
use glam::DVec3;

use super::found_cameras::{Cameras, Poses, camera};
use crate::Event;
use crate::Session;
use ostra_frames::cameras::{ModelEncoding, SparsePoints, write_colmap_model};
use ostra_frames::{Frame, FrameCamera};
use ostra_project::store::{
    ModelCameras, load_cameras, save_cameras, save_links, save_outcomes, sparse_path,
};
use ostra_project::{Coordinates, Edit, Project, ResultKind, ResultRecord, SparseModelRecord};

/// Saves cameras, points, keypoints and the outcome of each frame under the record's version, and
/// the other models under the versions after it. Returns the record with all models.
///
/// # Errors
///
/// Returns an error if a file cannot be written.
pub(super) fn save_models(
    root: &Path,
    project: &Project,
    result: &Cameras,
    poses: Poses,
    record: ResultRecord,
) -> Result<ResultRecord> {
    let frames = &project.frames;
    let folder = sparse_path(root, record.version);
    write_model(&folder, frames, &result.cameras, &result.sparse)?;
    save_outcomes(&folder, &result.outcomes)?;
    save_links(&folder, &result.links)?;
    if result.others.is_empty() {
        return Ok(record);
    }
    let origin = match poses {
        Poses::FromScratch => DVec3::ZERO,
        Poses::Kept => project.origin,
    };
    save_cameras(
        &folder,
        &model_cameras(frames, &result.cameras, poses, origin),
    )?;
    let mut models = vec![SparseModelRecord {
        version: record.version,
        frames: record.frames,
        points: result.sparse.points.len(),
        settings: record.settings.clone(),
        coordinates: record.coordinates.unwrap_or_else(|| project.coordinates()),
        scaled: record.scaled,
    }];
    for (other, version) in result.others.iter().zip(record.version + 1..) {
        let (model, folder) = (&other.model, sparse_path(root, version));
        write_model(&folder, frames, &model.cameras, &model.sparse)?;
        save_outcomes(&folder, &model.outcomes)?;
        let cameras = model_cameras(frames, &model.cameras, Poses::FromScratch, DVec3::ZERO);
        save_cameras(&folder, &cameras)?;
        models.push(SparseModelRecord {
            version,
            frames: model.cameras.len(),
            points: model.sparse.points.len(),
            settings: other.settings.clone(),
            coordinates: Coordinates::chosen_with(version, model.scale.is_some()),
            scaled: None,
        });
    }
    Ok(ResultRecord { models, ..record })
}

/// Writes a sparse model with the cameras of its frames.
fn write_model(
    folder: &Path,
    frames: &[Frame],
    cameras: &BTreeMap<usize, FrameCamera>,
    sparse: &SparsePoints,
) -> Result<()> {
    let mut placed = frames.to_vec();
    for (number, frame) in placed.iter_mut().enumerate() {
        frame.camera = cameras.get(&number).copied();
    }
    Ok(write_colmap_model(
        folder,
        &placed,
        sparse,
        ModelEncoding::Text,
    )?)
}

/// Returns the cameras that the project has while a model is used.
fn model_cameras(
    frames: &[Frame],
    found: &BTreeMap<usize, FrameCamera>,
    poses: Poses,
    origin: DVec3,
) -> ModelCameras {
    let cameras = frames
        .iter()
        .enumerate()
        .filter_map(|(number, known)| Some((number, camera(known, found.get(&number), poses)?)));
    ModelCameras {
        origin,
        cameras: cameras.collect(),
    }
}

/// Returns a warning that the images fall into several models, if they do.
pub(super) fn several_models(models: &[SparseModelRecord]) -> Option<String> {
    let (first, others) = models.split_first()?;
    let sizes: Vec<String> = others
        .iter()
        .map(|model| model.frames.to_string())
        .collect();
    Some(format!(
        "nothing connects all images: they fall into {} models, of {} and {} frames; model 1 is in use, 'ostra \
         select-model PROJECT 2' uses another one",
        models.len(),
        first.frames,
        sizes.join(" and ")
    ))
}

impl Session {
    /// Uses the cameras of another one of the models that the images fall into.
    ///
    /// Frames outside the model have no camera then. What was made with the former cameras becomes
    /// stale.
    pub(crate) fn select_model(&mut self, number: usize) -> Result<()> {
        self.check_no_long_job()?;
        let project = self.snapshot()?;
        let record = project.results.get(&ResultKind::Cameras);
        let record = record
            .filter(|record| !record.models.is_empty())
            .context("the cameras are one model; there is no other one to use")?;
        let count = record.models.len();
        let model = number
            .checked_sub(1)
            .and_then(|index| record.models.get(index))
            .with_context(|| {
                format!("there is no model {number}; the project has models 1 to {count}")
            })?;
        let folder = sparse_path(self.opened()?.root(), model.version);
        let stored = load_cameras(&folder).with_context(|| {
            format!("the cameras of model {number} cannot be read; reconstruct again")
        })?;
        let mut edits = vec![Edit::SetOrigin {
            origin: stored.origin,
        }];
        let frames = project.frames.iter().enumerate();
        edits.extend(frames.map(|(frame, known)| Edit::SetCamera {
            frame,
            camera: camera(known, stored.cameras.get(&frame), Poses::FromScratch),
        }));
        edits.push(Edit::SetResult {
            kind: ResultKind::Cameras,
            record: Some(record.with_model(model)),
        });
        self.commit(&format!("Use model {number}"), edits)?;
        self.events.push(Event::Notice(format!(
            "model {number} of {count} is in use: {} frames, {} points",
            model.frames, model.points
        )));
        Ok(())
    }
}

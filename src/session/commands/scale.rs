use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use glam::{DVec2, DVec3};

use crate::frames::cameras::{ModelEncoding, write_colmap_model};
use crate::frames::{DepthSource, Frame};
use crate::geometry::{Sighting, triangulate};
use crate::session::jobs::{Kind, Landing};
use crate::session::store::{
    load_links, load_outcomes, load_sparse, save_links, save_outcomes, sparse_path, sync_folder, version_in_force,
};
use crate::session::{Edit, Event, JobId, Project, ResultKind, ScaleEnd, ScaleRequest, Session};

impl Session {
    /// Makes cameras and sparse points larger or smaller until a length in the scene is what it is known to be.
    pub(in crate::session) fn scale(&mut self, request: &ScaleRequest) -> Result<JobId> {
        self.check_no_long_job()?;
        let project = self.snapshot()?;
        let factor = factor(&project, request)?;
        let root = self.opened()?.root().to_owned();
        let before = version_in_force(&project, ResultKind::Cameras);
        let version = if before.is_some() { self.opened()?.next_version()? } else { 0 };
        Ok(self.start("Set scale", Kind::Long, move |_| {
            let frames: Vec<Frame> = project.frames.iter().map(|frame| scaled(frame, factor)).collect();
            if let Some(before) = before {
                let mut sparse = load_sparse(&root, &project);
                sparse.points.iter_mut().for_each(|point| point.position *= factor);
                let folder = sparse_path(&root, version);
                write_colmap_model(&folder, &frames, &sparse, ModelEncoding::Text)?;
                save_outcomes(&folder, &load_outcomes(&sparse_path(&root, before))?)?;
                save_links(&folder, &load_links(&sparse_path(&root, before))?)?;
                sync_folder(&root.join("versions"))?;
            }
            Ok(Box::new(move |session: &mut Self| session.take_scale(&project, &frames, factor, version)) as Landing)
        }))
    }

    fn take_scale(&mut self, project: &Arc<Project>, frames: &[Frame], factor: f64, version: u64) -> Result<()> {
        ensure!(project.frames == self.snapshot()?.frames, "the cameras changed meanwhile; set the scale again");
        let mut edits: Vec<Edit> =
            frames.iter().enumerate().map(|(frame, scaled)| Edit::SetCamera { frame, camera: scaled.camera }).collect();
        let made = frames.iter().enumerate().filter(|(_, frame)| matches!(frame.depth, Some(DepthSource::Made { .. })));
        edits.extend(made.map(|(frame, scaled)| Edit::SetDepth { frame, depth: scaled.depth.clone() }));
        // Cameras and depths change together: what was made of them fits as before.
        edits.extend(
            project
                .results
                .get(&ResultKind::Depths)
                .map(|record| Edit::SetResult { kind: ResultKind::Depths, record: Some(record.clone()) }),
        );
        if let Some(record) = project.results.get(&ResultKind::Cameras) {
            let mut record = record.clone();
            record.settings += &format!(", scaled by {factor:.6}");
            record.version = version;
            edits.push(Edit::SetResult { kind: ResultKind::Cameras, record: Some(record) });
        }
        self.commit("Set scale", edits)?;
        self.events.push(Event::Notice(format!("cameras and points were scaled by {factor:.6}")));
        Ok(())
    }
}

fn scaled(frame: &Frame, factor: f64) -> Frame {
    let mut frame = frame.clone();
    if let Some(pose) = frame.camera.as_mut().and_then(|camera| camera.camera_from_world.as_mut()) {
        pose.translation *= factor;
    }
    if let Some(DepthSource::Made { scale, .. }) = &mut frame.depth {
        *scale *= factor;
    }
    frame
}

/// What lengths are multiplied by.
fn factor(project: &Project, request: &ScaleRequest) -> Result<f64> {
    ensure!(request.length > 0.0 && request.length.is_finite(), "the length must be above 0");
    let measured = project.frames.iter().any(|frame| frame.has_sensor_depth() && frame.posed_camera().is_some());
    ensure!(!measured, "the depth pictures tell the scale; it cannot be set to another");
    let [a, b] = &request.ends;
    let (a, b) = (place(project, a)?, place(project, b)?);
    let factor = request.length / a.distance(b);
    ensure!(factor.is_finite(), "both ends are the same point; give two different ones");
    Ok(factor)
}

fn place(project: &Project, end: &ScaleEnd) -> Result<DVec3> {
    match end {
        ScaleEnd::World(position) => Ok(*position),
        ScaleEnd::Seen(seen) => triangulated(project, seen),
    }
}

fn triangulated(project: &Project, seen: &[(usize, DVec2)]) -> Result<DVec3> {
    let mut sightings = Vec::new();
    for &(number, at_px) in seen {
        let frame = project.frames.get(number).with_context(|| format!("there is no frame {number}"))?;
        let (camera, camera_from_world) = frame
            .posed_camera()
            .with_context(|| format!("frame {number} has no camera; point at the end on one that has"))?;
        sightings.push(Sighting { camera, camera_from_world, at_px, at_plane: camera.unproject(at_px) });
    }
    ensure!(sightings.len() >= 2, "each end must be pointed at on two frames or more");
    triangulate(&sightings).context("the frames see an end from nearly the same place; point at it on others")
}

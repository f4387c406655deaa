use anyhow::{Context, Result, ensure};
use glam::{DVec2, DVec3};

use super::scaled_results::{ScaledResults, Scaling};
use crate::Event;
use crate::Session;
use crate::{JobCompletion, JobKind};
use ostra_cloud::measure::LengthUnit;
use ostra_core::job::JobId;
use ostra_geometry::{RayObservation, triangulate};
use ostra_project::{Project, ResultKind, ScaleEnd, ScaleRequest};

/// Maximum factor of one step, and of all steps together, because positions are 32-bit floats.
const LARGEST_STEP: f64 = 1e6;
const LARGEST: f64 = 1e12;

impl Session {
    /// Scales cameras, depths, points and surfaces.
    ///
    /// Afterwards, a length in the scene has its known value.
    pub(crate) fn scale(&mut self, request: &ScaleRequest) -> Result<JobId> {
        self.check_no_long_job()?;
        let project = self.snapshot()?;
        let factor = factor(&project, request)?;
        let (root, version) = (
            self.opened()?.root().to_owned(),
            self.opened()?.next_version()?,
        );
        let scaling = Scaling {
            project,
            root,
            factor,
            version,
        };
        Ok(self.start("Set scale", JobKind::Long, move |context| {
            let scaled = scaling.write(&context.progress)?;
            Ok(
                Box::new(move |session: &mut Self| session.take_scale(&scaling, scaled))
                    as JobCompletion,
            )
        }))
    }

    fn take_scale(&mut self, scaling: &Scaling, scaled: ScaledResults) -> Result<()> {
        let now = self.snapshot()?;
        let files = |project: &Project| -> Vec<(ResultKind, u64)> {
            project
                .results
                .iter()
                .map(|(&kind, record)| (kind, record.version))
                .collect()
        };
        ensure!(
            scaling.project.frames == now.frames && files(&scaling.project) == files(&now),
            "cameras or results changed meanwhile; set the scale again"
        );
        self.commit("Set scale", scaled.edits(scaling, &now))?;
        self.events.push(Event::Notice(scaled.notice(scaling)));
        self.warn_all(scaled.warnings);
        if let Some((cloud, votes)) = scaled.cloud.map(|cloud| (cloud.cloud, cloud.votes)) {
            self.background
                .cloud
                .put(Some(scaling.version), cloud, votes);
            self.events.push(Event::CloudChanged);
        }
        Ok(())
    }
}

/// Returns the factor by which lengths are multiplied.
fn factor(project: &Project, request: &ScaleRequest) -> Result<f64> {
    ensure!(
        request.length > 0.0 && request.length.is_finite(),
        "the known length must be a number above 0, got {}",
        request.length
    );
    let now = project.coordinates();
    let is_measured = project
        .frames
        .iter()
        .any(|frame| frame.has_sensor_depth() && frame.posed_camera().is_some());
    ensure!(
        !is_measured || now.unit == LengthUnit::World,
        "the sensor's depths give the scale already; if they are wrong, make the project again with another --depth-unit"
    );
    let is_world = request
        .ends
        .iter()
        .any(|end| matches!(end, ScaleEnd::World(_)));
    let same_world = project
        .cloud_coordinates()
        .is_some_and(|cloud| (cloud.world, cloud.scale) == (now.world, now.scale));
    ensure!(
        !is_world || same_world,
        "the cloud was made with other cameras than those of now; fuse again, then measure in it"
    );
    let [a, b] = &request.ends;
    let (a, b) = (position(project, a)?, position(project, b)?);
    ensure!(
        a.is_finite() && b.is_finite(),
        "an end of the known length has a coordinate that is not a finite number"
    );
    ensure!(
        a != b,
        "both ends are the same point; give two different ones"
    );
    let factor = request.length / a.distance(b);
    ensure!(
        (LARGEST_STEP.recip()..=LARGEST_STEP).contains(&factor)
            && (LARGEST.recip()..=LARGEST).contains(&(now.scale * factor)),
        "the points are {:e} apart: a length of {:e} between them would make everything {factor:e} times as large; \
         at most a million times larger or smaller is possible, check the length and both ends",
        a.distance(b),
        request.length
    );
    Ok(factor)
}

fn position(project: &Project, end: &ScaleEnd) -> Result<DVec3> {
    match end {
        ScaleEnd::World(position) => Ok(*position),
        ScaleEnd::Seen(seen) => triangulated(project, seen),
    }
}

fn triangulated(project: &Project, seen: &[(usize, DVec2)]) -> Result<DVec3> {
    let mut observations = Vec::new();
    for &(number, at_px) in seen {
        let frame = project.frame(number)?;
        let (camera, camera_from_world) = frame.posed_camera().with_context(|| {
            format!("frame {number} has no camera; point at the end on one that has")
        })?;
        observations.push(RayObservation {
            camera,
            camera_from_world,
            at_px,
            at_plane: camera.unproject(at_px),
        });
    }
    ensure!(
        observations.len() >= 2,
        "each end must be pointed at on two frames or more"
    );
    triangulate(&observations)
        .context("the frames see an end from nearly the same place; point at it on others")
}

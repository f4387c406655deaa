use std::collections::BTreeMap;
use std::sync::Arc;

use super::jobs::Link;
use super::{Event, JobId, Session};
use crate::frames::{Frame, FrameStore};
use crate::scene::stereo::{DepthEstimate, DepthStore, Stage, raster_image};
use crate::scene::{LabelledCloud, SceneError};

/// Points shown of each view while depth is made.
const POINTS_A_VIEW: usize = 20_000;
/// What a pixel's depth must be sure to, 0–255, to be shown before it was filtered.
const SURE: u8 = 160;

/// Points of the depths that a job has made so far, to be looked at while it runs.
#[derive(Default)]
pub(super) struct Growing {
    job: Option<JobId>,
    views: BTreeMap<usize, LabelledCloud>,
    cloud: Arc<LabelledCloud>,
}

impl Session {
    /// The points of the depths that are being made; `None` unless a job makes some and has a view done.
    #[must_use]
    pub fn growing_cloud(&self) -> Option<&Arc<LabelledCloud>> {
        let running = self.jobs().iter().any(|job| Some(job.id) == self.growing.job);
        Some(&self.growing.cloud).filter(|cloud| running && !cloud.is_empty())
    }

    /// Takes over the points of one view; those of another job go.
    fn grow(&mut self, job: JobId, frame: usize, points: LabelledCloud) {
        if self.growing.job != Some(job) {
            self.growing = Growing { job: Some(job), ..Growing::default() };
        }
        self.growing.views.insert(frame, points);
        let mut cloud = LabelledCloud::default();
        for view in self.growing.views.values() {
            cloud.append(view);
        }
        self.growing.cloud = Arc::new(cloud);
        self.events.push(Event::CloudChanged);
    }
}

/// A store of depths that shows the session what comes into it.
pub(super) struct Shown<'a> {
    pub(super) depths: &'a dyn DepthStore,
    pub(super) frames: &'a [Frame],
    pub(super) pictures: &'a FrameStore,
    pub(super) max_side: u32,
    pub(super) link: &'a Link,
}

impl DepthStore for Shown<'_> {
    fn load(&self, frame: usize, stage: Stage) -> Result<Option<Arc<DepthEstimate>>, SceneError> {
        self.depths.load(frame, stage)
    }

    fn has(&self, frame: usize, stage: Stage) -> bool {
        self.depths.has(frame, stage)
    }

    fn save(&self, frame: usize, stage: Stage, estimate: DepthEstimate) -> Result<(), SceneError> {
        if self.link.is_watched() {
            let least = if stage == Stage::Filtered { 0 } else { SURE };
            let (points, job) = (self.points(frame, &estimate, least)?, self.link.job());
            self.link.send(move |session: &mut Session| {
                session.grow(job, frame, points);
                Ok(())
            })?;
        }
        self.depths.save(frame, stage, estimate)
    }

    fn forget(&self, stage: Stage) -> Result<(), SceneError> {
        self.depths.forget(stage)
    }
}

impl Shown<'_> {
    /// An evenly spread part of a view's points that are at least so sure.
    fn points(&self, frame: usize, estimate: &DepthEstimate, least: u8) -> Result<LabelledCloud, SceneError> {
        let mut cloud = LabelledCloud::default();
        let Some((lens, pose)) = self.frames[frame].posed_camera() else { return Ok(cloud) };
        let colors = raster_image(&self.frames[frame], lens, self.pictures, self.max_side)?;
        let world_from_camera = pose.inverse();
        let known =
            (0..estimate.depths.len()).filter(|&at| estimate.depths[at] > 0.0 && estimate.confidence[at] >= least);
        let step = (known.clone().count() / POINTS_A_VIEW).max(1);
        for at in known.step_by(step) {
            let (x, y) = (at % estimate.width(), at / estimate.width());
            let ray = estimate.camera.unproject(glam::DVec2::new(x as f64 + 0.5, y as f64 + 0.5)).extend(1.0);
            let position = world_from_camera.transform(ray * f64::from(estimate.depths[at]));
            cloud.push(position.as_vec3(), colors.pixels[at]);
        }
        Ok(cloud)
    }
}

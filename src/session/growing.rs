use std::collections::BTreeMap;
use std::sync::Arc;

use super::Session;
use super::jobs::Link;
use crate::Event;
use ostra_cloud::{LabelledCloud, SceneError};
use ostra_core::job::JobId;
use ostra_frames::{Frame, FrameStore};
use ostra_geometry::Pose;
use ostra_reconstruct::stereo::{DepthEstimate, DepthStore, Stage, raster_image};

/// Points shown of each view while a reconstruction runs, and of all together.
const POINTS_A_VIEW: usize = 20_000;
const POINTS: usize = 2_000_000;
/// What a pixel's depth must be sure to, 0–255, to be shown before it was filtered.
const SURE: u8 = 160;

/// Points that a job has made or placed so far, to be looked at while it runs.
#[derive(Default)]
pub(super) struct Growing {
    job: Option<JobId>,
    views: BTreeMap<usize, LabelledCloud>,
    cloud: Arc<LabelledCloud>,
    /// Views came since the cloud was put together.
    news: bool,
}

impl Session {
    /// The points of the depths that are being made or placed; `None` unless a job does so and has a view done.
    #[must_use]
    pub fn growing_cloud(&self) -> Option<&Arc<LabelledCloud>> {
        let running = self
            .jobs()
            .iter()
            .any(|job| Some(job.id) == self.growing.job);
        Some(&self.growing.cloud).filter(|cloud| running && !cloud.is_empty())
    }

    /// Takes over the points of one view; those of another job go.
    fn grow(&mut self, job: JobId, frame: usize, points: LabelledCloud) {
        if self.growing.job != Some(job) {
            self.growing = Growing {
                job: Some(job),
                ..Growing::default()
            };
        }
        self.growing.views.insert(frame, points);
        self.growing.news = true;
    }

    /// Puts together what came since the last time.
    pub(super) fn gather_growing(&mut self) {
        if !std::mem::take(&mut self.growing.news) {
            return;
        }
        let mut cloud = LabelledCloud::default();
        for view in self.growing.views.values() {
            cloud.append(view);
        }
        self.growing.cloud = Arc::new(cloud);
        self.events.push(Event::CloudChanged);
    }
}

/// Shows the session what a sensor sees in frames whose cameras come to be known.
pub(super) struct Placed<'a> {
    pub(super) frames: &'a [Frame],
    pub(super) pictures: &'a FrameStore,
    pub(super) link: &'a Link,
}

impl Placed<'_> {
    /// Sends the points of a frame under a pose. A frame that cannot be read shows nothing: who finds the cameras reads it
    /// too, and tells.
    pub(super) fn show(&self, frame: usize, camera_from_world: &Pose) {
        if let Some(points) = self
            .link
            .is_watched()
            .then(|| self.points(frame, camera_from_world))
            .flatten()
        {
            let job = self.link.job();
            let grow = move |session: &mut Session| {
                session.grow(job, frame, points);
                Ok(())
            };
            // A job that was stopped ends by itself.
            let _ = self.link.send(grow);
        }
    }

    fn points(&self, number: usize, camera_from_world: &Pose) -> Option<LabelledCloud> {
        let frame = &self.frames[number];
        let (lens, depth) = (frame.camera?.intrinsics, self.pictures.depth(frame).ok()??);
        let picture = self.pictures.image(frame).ok()?;
        let world_from_camera = camera_from_world.inverse();
        let most = (POINTS / self.frames.len().max(1)).min(POINTS_A_VIEW);
        // A step that shares no factor with the width: no columns of pixels.
        let step = (depth.depths.len() / most.max(1)).max(1) | 1;
        let mut cloud = LabelledCloud::default();
        for at in (0..depth.depths.len())
            .step_by(step)
            .filter(|&at| depth.depths[at] > 0.0)
        {
            let (x, y) = (at as u32 % depth.width, at as u32 / depth.width);
            let at_px = glam::DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let ray = lens.unproject(at_px).extend(1.0) * f64::from(depth.depths[at]);
            cloud.push(world_from_camera.transform(ray).as_vec3(), picture.at(x, y));
        }
        Some(cloud)
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

    fn save(&self, frame: usize, stage: Stage, estimate: DepthEstimate) -> Result<(), SceneError> {
        if self.link.is_watched() {
            let least = if let Stage::Round(_) = stage { SURE } else { 0 };
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
    fn points(
        &self,
        frame: usize,
        estimate: &DepthEstimate,
        least: u8,
    ) -> Result<LabelledCloud, SceneError> {
        let mut cloud = LabelledCloud::default();
        let Some((lens, pose)) = self.frames[frame].posed_camera() else {
            return Ok(cloud);
        };
        let colors = raster_image(&self.frames[frame], lens, self.pictures, self.max_side)?;
        let world_from_camera = pose.inverse();
        let known = (0..estimate.depths.len())
            .filter(|&at| estimate.depths[at] > 0.0 && estimate.confidence[at] >= least);
        let step = (known.clone().count() / POINTS_A_VIEW).max(1);
        for at in known.step_by(step) {
            let (x, y) = (at % estimate.width(), at / estimate.width());
            let ray = estimate
                .camera
                .unproject(glam::DVec2::new(x as f64 + 0.5, y as f64 + 0.5))
                .extend(1.0);
            let position = world_from_camera.transform(ray * f64::from(estimate.depths[at]));
            cloud.push(position.as_vec3(), colors.pixels[at]);
        }
        Ok(cloud)
    }
}

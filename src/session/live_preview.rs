use std::collections::BTreeMap;
use std::sync::Arc;

use ostra_cloud::{LabelledCloud, SceneError};
use ostra_core::job::{JobId, Stopped};
use ostra_frames::{Frame, FrameStore};
use ostra_geometry::Pose;
use ostra_reconstruct::stereo::{DepthEstimate, DepthStore, FilterOptions, Stage, raster_image};

/// Maximum number of points shown per view and in total while a reconstruction runs.
const POINTS_A_VIEW: usize = 20_000;
const POINTS: usize = 2_000_000;
/// Minimum confidence, 0–255, at which a pixel's depth is shown before filtering.
const CONFIDENT: u8 = 160;
/// Minimum share of a view's pixels in a connected surface that is shown before filtering.
///
/// Smaller ones are mostly wrong. They lie scattered between the cameras and the object, and hide it.
const SURFACE_SHARE: f32 = 0.001;

/// Points that a running job has made or placed so far, for display.
///
/// This is not a query: the job sends the points view by view, without a request.
#[derive(Default)]
pub(crate) struct LivePreview {
    job: Option<JobId>,
    views: BTreeMap<usize, LabelledCloud>,
    cloud: Arc<LabelledCloud>,
    /// Frames of the project when the job had ended; `None` before.
    ended_with: Option<Arc<Vec<Frame>>>,
    /// Whether views were added since the cloud was assembled.
    has_news: bool,
}

impl LivePreview {
    /// Returns the job whose points these are.
    pub(crate) fn job(&self) -> Option<JobId> {
        self.job
    }

    /// Returns the points at the last [`Self::gather`].
    pub(crate) fn cloud(&self) -> &Arc<LabelledCloud> {
        &self.cloud
    }

    /// Notes the frames of the project at the end of the job; later ones change nothing.
    pub(crate) fn end(&mut self, frames: &Arc<Vec<Frame>>) {
        if self.job.is_some() && self.ended_with.is_none() {
            self.ended_with = Some(Arc::clone(frames));
        }
    }

    /// Returns whether the job has ended with these frames.
    pub(crate) fn is_of(&self, frames: &Arc<Vec<Frame>>) -> bool {
        self.ended_with
            .as_ref()
            .is_some_and(|ended_with| Arc::ptr_eq(ended_with, frames))
    }

    /// Adds the points of one view, and drops those of another job.
    pub(crate) fn add(&mut self, job: JobId, frame: usize, points: LabelledCloud) {
        if self.job != Some(job) {
            *self = Self {
                job: Some(job),
                ..Self::default()
            };
        }
        self.views.insert(frame, points);
        self.has_news = true;
    }

    /// Assembles the cloud if views were added since the last time; returns whether any were.
    pub(crate) fn gather(&mut self) -> bool {
        if !std::mem::take(&mut self.has_news) {
            return false;
        }
        let mut cloud = LabelledCloud::default();
        for view in self.views.values() {
            cloud.append(view);
        }
        self.cloud = Arc::new(cloud);
        true
    }
}

/// Receiver of a job's partial results for the preview.
pub(crate) trait PreviewSink: Sync {
    /// Returns whether the preview is shown.
    fn is_watched(&self) -> bool;

    /// Adds the points of one view.
    ///
    /// # Errors
    ///
    /// Returns [`Stopped`] if the receiver no longer exists.
    fn show(&self, frame: usize, points: LabelledCloud) -> Result<(), Stopped>;
}

/// Preview of sensor depth in frames whose poses are found one by one.
pub(crate) struct PlacedFrames<'a> {
    pub(crate) frames: &'a [Frame],
    pub(crate) images: &'a FrameStore,
    pub(crate) sink: &'a dyn PreviewSink,
}

impl PlacedFrames<'_> {
    /// Shows the points of a frame with a pose.
    ///
    /// A frame that cannot be read shows nothing. The search for the cameras reads it too, and
    /// reports the error.
    pub(crate) fn show(&self, frame: usize, camera_from_world: &Pose) {
        if let Some(points) = self
            .sink
            .is_watched()
            .then(|| self.points(frame, camera_from_world))
            .flatten()
        {
            // A job that was stopped ends by itself.
            let _ = self.sink.show(frame, points);
        }
    }

    fn points(&self, number: usize, camera_from_world: &Pose) -> Option<LabelledCloud> {
        let frame = &self.frames[number];
        let (lens, depth) = (frame.camera?.intrinsics, self.images.depth(frame).ok()??);
        let image = self.images.image(frame).ok()?;
        let world_from_camera = camera_from_world.inverse();
        let most = (POINTS / self.frames.len().max(1)).min(POINTS_A_VIEW);
        // An odd step avoids columns of pixels for widths that are powers of two.
        let step = (depth.depths.len() / most.max(1)).max(1) | 1;
        let mut cloud = LabelledCloud::default();
        for at in (0..depth.depths.len())
            .step_by(step)
            .filter(|&at| depth.depths[at] > 0.0)
        {
            let (x, y) = (at as u32 % depth.width, at as u32 / depth.width);
            let at_px = glam::DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let ray = lens.unproject(at_px).extend(1.0) * f64::from(depth.depths[at]);
            cloud.push(world_from_camera.transform(ray).as_vec3(), image.at(x, y));
        }
        Some(cloud)
    }
}

/// A depth store that previews the depths saved to it.
pub(crate) struct WatchedDepths<'a> {
    pub(crate) depths: &'a dyn DepthStore,
    pub(crate) frames: &'a [Frame],
    pub(crate) images: &'a FrameStore,
    pub(crate) max_side: u32,
    pub(crate) sink: &'a dyn PreviewSink,
}

impl DepthStore for WatchedDepths<'_> {
    fn load(&self, frame: usize, stage: Stage) -> Result<Option<Arc<DepthEstimate>>, SceneError> {
        self.depths.load(frame, stage)
    }

    fn save(&self, frame: usize, stage: Stage, estimate: DepthEstimate) -> Result<(), SceneError> {
        if self.sink.is_watched() {
            let points = if let Stage::Round(_) = stage {
                let least = (SURFACE_SHARE * estimate.depths.len() as f32) as usize;
                let mut surfaces = estimate.clone();
                surfaces.keep_surfaces(
                    CONFIDENT,
                    least,
                    FilterOptions::default().surface_tolerance,
                );
                self.points(frame, &surfaces)?
            } else {
                self.points(frame, &estimate)?
            };
            self.sink.show(frame, points)?;
        }
        self.depths.save(frame, stage, estimate)
    }

    fn forget(&self, stage: Stage) -> Result<(), SceneError> {
        self.depths.forget(stage)
    }
}

impl WatchedDepths<'_> {
    /// Returns an evenly spaced sample of a view's points.
    fn points(&self, frame: usize, estimate: &DepthEstimate) -> Result<LabelledCloud, SceneError> {
        let mut cloud = LabelledCloud::default();
        let Some((lens, pose)) = self.frames[frame].posed_camera() else {
            return Ok(cloud);
        };
        let colors = raster_image(&self.frames[frame], lens, self.images, self.max_side)?;
        let world_from_camera = pose.inverse();
        let known = (0..estimate.depths.len()).filter(|&at| estimate.depths[at] > 0.0);
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

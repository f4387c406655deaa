use std::sync::{Arc, Mutex, PoisonError};

use super::frame::FrameBodies;
use super::surfaces::SurfacePartitions;
use super::voxels::ColoredView;
use crate::reprojection::{DepthViews, fillers_for};
use ostra_cloud::SceneError;
use ostra_core::job::Progress;
use ostra_frames::{DepthMap, Frame, FrameStore, Image};
use ostra_masks::{MaskError, PreparedFrame, Segmenter};

/// Maximum number of other frames that the surfaces are made of.
const MOST_VIEWS: usize = 16;
/// Minimum number of frames that see the same surfaces.
pub const LEAST_VIEWS: usize = 3;

/// Frame indices, and their depth and images.
type CachedViews = (Vec<usize>, Vec<ColoredView>);

/// The segmenter `geometry`: selects objects by their connectivity in 3-D.
///
/// It needs clicks on one frame with depth and a camera, and uses all frames around it. Thin
/// objects, boxes, and frames without others around them are left to another segmenter. Unreadable
/// frames are ignored.
pub struct GeometrySegmenter {
    frames: Arc<Vec<Frame>>,
    store: Arc<FrameStore>,
    prepared: Arc<dyn Segmenter>,
    /// The latest surfaces, with the frames that they are made of.
    made: Mutex<Option<(Vec<usize>, Arc<SurfacePartitions>)>>,
}

impl GeometrySegmenter {
    /// Creates a segmenter for frames of one scene.
    ///
    /// `picture` is the segmenter for single images.
    #[must_use]
    pub fn new(
        frames: Arc<Vec<Frame>>,
        store: Arc<FrameStore>,
        prepared: Arc<dyn Segmenter>,
    ) -> Self {
        Self {
            frames,
            store,
            prepared,
            made: Mutex::default(),
        }
    }

    /// Returns whether the segmenter was created for these frames.
    #[must_use]
    pub fn is_for(&self, frames: &Arc<Vec<Frame>>) -> bool {
        Arc::ptr_eq(&self.frames, frames)
    }

    /// Returns a frame and those that see the same surfaces, with their indices.
    ///
    /// The frame itself comes first. Returns `None` if too few frames can be read.
    fn views_of(
        &self,
        views: &DepthViews<'_>,
        frame: usize,
    ) -> Result<Option<CachedViews>, MaskError> {
        if views.calibrated_view(frame).is_none() {
            return Ok(None);
        }
        let others = views
            .calibrated_views()
            .filter(|&(other, _)| other != frame);
        let (Some(view), Some(image)) = (views.load(frame)?, views.image(frame)?) else {
            return Ok(None);
        };
        let around = fillers_for(&view, others, MOST_VIEWS);
        let (mut numbers, mut loaded) = (vec![frame], vec![ColoredView { view, image }]);
        for other in around {
            if let (Some(view), Some(image)) = (views.load(other)?, views.image(other)?) {
                numbers.push(other);
                loaded.push(ColoredView { view, image });
            }
        }
        Ok((loaded.len() >= LEAST_VIEWS).then_some((numbers, loaded)))
    }

    /// Returns the surfaces around a frame; reuses the latest ones if they include the frame.
    fn surfaces(
        &self,
        of: &[usize],
        views: &[ColoredView],
        progress: &Progress,
    ) -> Result<Arc<SurfacePartitions>, SceneError> {
        let mut made = self.made.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, surfaces)) = made.as_ref().filter(|(frames, _)| frames.contains(&of[0])) {
            return Ok(Arc::clone(surfaces));
        }
        let surfaces = Arc::new(SurfacePartitions::of(views, progress)?);
        *made = Some((of.to_vec(), Arc::clone(&surfaces)));
        Ok(surfaces)
    }

    /// Returns the segmenter for single images.
    pub(super) fn pictures(&self) -> &dyn Segmenter {
        self.prepared.as_ref()
    }

    /// Returns the frames of the scene.
    pub(super) fn frames(&self) -> &[Frame] {
        &self.frames
    }

    /// Returns a frame with its connected surfaces; `None` if too few frames see the same ones.
    ///
    /// `prepared` is the frame, prepared by the segmenter for single images.
    pub(super) fn bodies(
        &self,
        frame: &Frame,
        prepared: &Arc<dyn PreparedFrame>,
        progress: &Progress,
    ) -> Result<Option<FrameBodies>, MaskError> {
        let Some(number) = self.frames.iter().position(|other| other == frame) else {
            return Ok(None);
        };
        match self.supervoxels(number, prepared, progress) {
            Ok(supervoxels) => Ok(supervoxels),
            Err(SceneError::Stopped(stopped)) => Err(stopped.into()),
            Err(SceneError::Mask(error)) => Err(error),
            Err(error) => Err(MaskError::Request(error.to_string())),
        }
    }

    fn supervoxels(
        &self,
        frame: usize,
        prepared: &Arc<dyn PreparedFrame>,
        progress: &Progress,
    ) -> Result<Option<FrameBodies>, SceneError> {
        let views = DepthViews::new(&self.frames, &self.store);
        let Some((of, loaded)) = self.views_of(&views, frame)? else {
            return Ok(None);
        };
        let surfaces = self.surfaces(&of, &loaded, progress)?;
        FrameBodies::new(surfaces, &loaded, Arc::clone(prepared), progress).map(Some)
    }
}

impl Segmenter for GeometrySegmenter {
    fn name(&self) -> &'static str {
        "geometry"
    }

    fn prepare(
        &self,
        image: &Arc<Image>,
        depth: Option<&Arc<DepthMap>>,
        progress: &Progress,
    ) -> Result<Arc<dyn PreparedFrame>, MaskError> {
        self.prepared.prepare(image, depth, progress)
    }

    fn prepare_frame(
        &self,
        frame: &Frame,
        image: &Arc<Image>,
        depth: Option<&Arc<DepthMap>>,
        progress: &Progress,
    ) -> Result<Arc<dyn PreparedFrame>, MaskError> {
        let prepared = self.prepared.prepare_frame(frame, image, depth, progress)?;
        let bodies = self.bodies(frame, &prepared, progress)?;
        Ok(bodies.map_or(prepared, |bodies| Arc::new(bodies)))
    }

    fn basis(&self) -> String {
        // The result depends on poses and depths of all frames. The frames are kept in memory, so
        // their address identifies them.
        format!("{:p}", Arc::as_ptr(&self.frames))
    }
}

use std::sync::{Arc, Mutex, PoisonError};

use super::frame::FrameBodies;
use super::surfaces::Surfaces;
use crate::reprojection::{DepthView, DepthViews, fillers_for};
use ostra_cloud::SceneError;
use ostra_core::job::Progress;
use ostra_frames::{DepthMap, Frame, FrameStore, Image};
use ostra_masks::{MaskError, PreparedFrame, Segmenter};

/// Frames that surfaces are made of, the one asked for besides.
const MOST_VIEWS: usize = 16;
/// With fewer frames that see the same, space says too little.
const LEAST_VIEWS: usize = 3;

/// Numbers of frames, and what they show.
type Seen = (Vec<usize>, Vec<(DepthView, Arc<Image>)>);

/// The segmenter `geometry`: takes what hangs together in space, over all frames around the clicked one, by clicks on one
/// frame with depth and camera. What is thin, boxes, and frames without others around them are left to another segmenter;
/// frames that cannot be read do not count.
pub struct GeometrySegmenter {
    frames: Arc<Vec<Frame>>,
    store: Arc<FrameStore>,
    picture: Arc<dyn Segmenter>,
    /// The surfaces made last, with the frames that they are of.
    made: Mutex<Option<(Vec<usize>, Arc<Surfaces>)>>,
}

impl GeometrySegmenter {
    /// For some frames of one scene; `image` is the segmenter that knows single images.
    #[must_use]
    pub fn new(
        frames: Arc<Vec<Frame>>,
        store: Arc<FrameStore>,
        picture: Arc<dyn Segmenter>,
    ) -> Self {
        Self {
            frames,
            store,
            picture,
            made: Mutex::default(),
        }
    }

    /// Whether it works for these very frames.
    #[must_use]
    pub fn is_for(&self, frames: &Arc<Vec<Frame>>) -> bool {
        Arc::ptr_eq(&self.frames, frames)
    }

    /// A frame and those that see the same, the frame first, with their numbers; `None` where too few can be read.
    fn views_of(&self, views: &DepthViews<'_>, frame: usize) -> Result<Option<Seen>, MaskError> {
        if views.posed_camera(frame).is_none() {
            return Ok(None);
        }
        let others = views.posed_cameras().filter(|&(other, _)| other != frame);
        let (Some(own), Some(image)) = (views.load(frame)?, views.image(frame)?) else {
            return Ok(None);
        };
        let around = fillers_for(&own, others, MOST_VIEWS);
        let (mut numbers, mut loaded) = (vec![frame], vec![(own, image)]);
        for other in around {
            if let (Some(view), Some(image)) = (views.load(other)?, views.image(other)?) {
                numbers.push(other);
                loaded.push((view, image));
            }
        }
        Ok((loaded.len() >= LEAST_VIEWS).then_some((numbers, loaded)))
    }

    /// The surfaces around a frame: those made last where they are of this frame too.
    fn surfaces(
        &self,
        of: &[usize],
        views: &[(DepthView, Arc<Image>)],
        progress: &Progress,
    ) -> Result<Arc<Surfaces>, SceneError> {
        let mut made = self.made.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, surfaces)) = made.as_ref().filter(|(frames, _)| frames.contains(&of[0])) {
            return Ok(Arc::clone(surfaces));
        }
        let surfaces = Arc::new(Surfaces::of(views, progress)?);
        *made = Some((of.to_vec(), Arc::clone(&surfaces)));
        Ok(surfaces)
    }

    fn bodies(
        &self,
        frame: usize,
        picture: &Arc<dyn PreparedFrame>,
        progress: &Progress,
    ) -> Result<Option<FrameBodies>, SceneError> {
        let views = DepthViews::new(&self.frames, &self.store);
        let Some((of, loaded)) = self.views_of(&views, frame)? else {
            return Ok(None);
        };
        let surfaces = self.surfaces(&of, &loaded, progress)?;
        FrameBodies::new(surfaces, &loaded, Arc::clone(picture), progress).map(Some)
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
        self.picture.prepare(image, depth, progress)
    }

    fn prepare_frame(
        &self,
        frame: &Frame,
        image: &Arc<Image>,
        depth: Option<&Arc<DepthMap>>,
        progress: &Progress,
    ) -> Result<Arc<dyn PreparedFrame>, MaskError> {
        let picture = self.prepare(image, depth, progress)?;
        let Some(number) = self.frames.iter().position(|other| other == frame) else {
            return Ok(picture);
        };
        match self.bodies(number, &picture, progress) {
            Ok(bodies) => Ok(bodies.map_or(picture, |bodies| Arc::new(bodies))),
            Err(SceneError::Stopped(stopped)) => Err(stopped.into()),
            Err(SceneError::Mask(error)) => Err(error),
            Err(error) => Err(MaskError::Request(error.to_string())),
        }
    }

    fn basis(&self) -> String {
        // Poses and depths of all frames; the frames are kept, so that the place stays theirs.
        format!("{:p}", Arc::as_ptr(&self.frames))
    }
}

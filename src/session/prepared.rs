use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

use anyhow::Result;

use ostra_cloud::SceneError;
use ostra_cloud::fuse::readable;
use ostra_core::job::{JobId, Progress, Stopped};
use ostra_frames::{DepthMap, Frame, FrameStore, Image};
use ostra_masks::graph_cut::{BuiltinSegmenter, settled};
use ostra_masks::{MaskError, PreparedFrame, Segmenter};
use ostra_project::SegmenterId;
use ostra_tracking::supervoxels::GeometrySegmenter;

/// Memory for frames prepared for prompts, in bytes.
const PREPARED_BYTES: usize = 384 << 20;

/// State that is kept between prompts.
pub(crate) struct Prompting {
    pub(crate) prepared: Arc<PreparedFrames>,
    /// Geometry segmenter for the project's frames.
    geometry: Option<Arc<GeometrySegmenter>>,
    /// The last request to prepare a frame.
    pub(crate) preparing: Option<Preparation>,
    /// What was last reported about the segmenter that `auto` took.
    pub(crate) reported: Option<String>,
}

/// A request to prepare a frame in the background.
pub(crate) struct Preparation {
    /// Name of the frame.
    pub(crate) frame: String,
    /// The segmenter.
    pub(crate) segmenter: SegmenterId,
    /// The project's frames, with their cameras and depths.
    pub(crate) frames: Weak<Vec<Frame>>,
    /// The job that prepares the frame.
    pub(crate) job: JobId,
}

impl Preparation {
    /// Returns whether this is the preparation of one of these frames.
    pub(crate) fn is_of(&self, frames: &Arc<Vec<Frame>>, frame: &str) -> bool {
        self.frame == frame && Weak::as_ptr(&self.frames) == Arc::as_ptr(frames)
    }
}

impl Default for Prompting {
    fn default() -> Self {
        Self {
            prepared: Arc::new(PreparedFrames::new(PREPARED_BYTES)),
            geometry: None,
            preparing: None,
            reported: None,
        }
    }
}

impl Prompting {
    /// Drops prepared frames and geometry; they are made again when needed.
    pub(crate) fn release_memory(&mut self) {
        self.prepared = Arc::new(PreparedFrames::new(PREPARED_BYTES));
        self.geometry = None;
    }

    /// Returns the geometry segmenter for these frames.
    pub(crate) fn geometry_for(
        &mut self,
        frames: &Arc<Vec<Frame>>,
        store: &Arc<FrameStore>,
    ) -> Arc<GeometrySegmenter> {
        let kept = self.geometry.take().filter(|kept| kept.is_for(frames));
        let make = || {
            let pictures = SharedPictures(Arc::clone(&self.prepared));
            Arc::new(GeometrySegmenter::new(
                Arc::clone(frames),
                Arc::clone(store),
                Arc::new(pictures),
            ))
        };
        Arc::clone(self.geometry.insert(kept.unwrap_or_else(make)))
    }
}

/// The built-in segmenter, which takes frames that are prepared already.
struct SharedPictures(Arc<PreparedFrames>);

impl Segmenter for SharedPictures {
    fn name(&self) -> &'static str {
        BuiltinSegmenter.name()
    }

    fn prepare(
        &self,
        image: &Arc<Image>,
        depth: Option<&Arc<DepthMap>>,
        progress: &Progress,
    ) -> Result<Arc<dyn PreparedFrame>, MaskError> {
        BuiltinSegmenter.prepare(image, depth, progress)
    }

    fn prepare_frame(
        &self,
        frame: &Frame,
        image: &Arc<Image>,
        depth: Option<&Arc<DepthMap>>,
        progress: &Progress,
    ) -> Result<Arc<dyn PreparedFrame>, MaskError> {
        let inputs = || Ok((Arc::clone(image), depth.cloned()));
        self.0
            .get_with(&BuiltinSegmenter, frame, inputs, progress)
            .map_err(|error| match error.downcast::<MaskError>() {
                Ok(error) => error,
                Err(error) if error.is::<Stopped>() => Stopped.into(),
                Err(error) => MaskError::Request(format!("{error:#}")),
            })
    }
}

/// Cache of frames prepared by segmenters, bounded in bytes and shared by all threads.
///
/// The least recently used frames are dropped.
pub struct PreparedFrames {
    slots: Mutex<Slots>,
    budget_bytes: usize,
}

#[derive(Default)]
struct Slots {
    by_key: BTreeMap<String, PreparedSlot>,
    clock: u64,
}

#[derive(Default)]
struct PreparedSlot {
    used: u64,
    bytes: usize,
    frame: Ready,
}

/// Slot that is locked while the frame is prepared.
///
/// Threads that need the same frame wait for it instead of preparing it again.
type Ready = Arc<Mutex<Option<Arc<dyn PreparedFrame>>>>;

impl PreparedFrames {
    /// Creates a cache of at most `budget_bytes`.
    ///
    /// The last used frame is always kept.
    #[must_use]
    pub fn new(budget_bytes: usize) -> Self {
        Self {
            slots: Mutex::default(),
            budget_bytes,
        }
    }

    /// Returns the prepared frame, from the cache if possible.
    ///
    /// If its depth cannot be read, the frame is prepared without it.
    ///
    /// # Errors
    ///
    /// Returns an error if the image cannot be read, the segmenter fails, or the progress is
    /// stopped.
    pub fn get(
        &self,
        segmenter: &dyn Segmenter,
        frame: &Frame,
        store: &FrameStore,
        progress: &Progress,
    ) -> Result<Arc<dyn PreparedFrame>> {
        let inputs = || {
            let image = store.image(frame)?;
            let depth = match readable(store.depth(frame).map_err(SceneError::from))?.flatten() {
                // Depth borders from stereo are a few pixels off, because of its windows.
                Some(made) if !frame.has_sensor_depth() => Some(Arc::new(settled(&made, &image))),
                depth => depth,
            };
            Ok((image, depth))
        };
        self.get_with(segmenter, frame, inputs, progress)
    }

    /// Returns the prepared frame if it is in the cache, without waiting for it.
    pub(crate) fn ready(
        &self,
        segmenter: &dyn Segmenter,
        frame: &Frame,
    ) -> Option<Arc<dyn PreparedFrame>> {
        let slot = {
            let slots = self.lock();
            Arc::clone(&slots.by_key.get(&key(segmenter, frame))?.frame)
        };
        let ready = slot.try_lock().ok()?;
        ready.clone()
    }

    /// Returns the prepared frame as [`Self::get`]; `inputs` are its image and depth.
    fn get_with(
        &self,
        segmenter: &dyn Segmenter,
        frame: &Frame,
        inputs: impl FnOnce() -> Result<(Arc<Image>, Option<Arc<DepthMap>>)>,
        progress: &Progress,
    ) -> Result<Arc<dyn PreparedFrame>> {
        let key = key(segmenter, frame);
        let ready = self.slot(&key);
        let mut ready = ready.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(prepared) = ready.as_ref() {
            return Ok(Arc::clone(prepared));
        }
        progress.stage("prepare")?;
        let (image, depth) = inputs()?;
        let prepared = segmenter.prepare_frame(frame, &image, depth.as_ref(), progress)?;
        *ready = Some(Arc::clone(&prepared));
        drop(ready);
        self.weigh(&key, prepared.bytes());
        Ok(prepared)
    }

    /// Returns whether this many bytes can be kept at once.
    #[must_use]
    pub fn has_room_for(&self, bytes: usize) -> bool {
        bytes <= self.budget_bytes
    }

    fn slot(&self, key: &str) -> Ready {
        let mut slots = self.lock();
        slots.clock += 1;
        let now = slots.clock;
        let slot = slots.by_key.entry(key.to_owned()).or_default();
        slot.used = now;
        Arc::clone(&slot.frame)
    }

    fn weigh(&self, key: &str, bytes: usize) {
        let mut slots = self.lock();
        if let Some(slot) = slots.by_key.get_mut(key) {
            slot.bytes = bytes;
        }
        while slots.by_key.len() > 1
            && slots.by_key.values().map(|slot| slot.bytes).sum::<usize>() > self.budget_bytes
        {
            let oldest = slots
                .by_key
                .iter()
                .min_by_key(|(_, slot)| slot.used)
                .map(|(key, _)| key.clone());
            let Some(oldest) = oldest else { break };
            slots.by_key.remove(&oldest);
        }
    }

    fn lock(&self) -> MutexGuard<'_, Slots> {
        self.slots.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Returns all that a prepared frame depends on.
fn key(segmenter: &dyn Segmenter, frame: &Frame) -> String {
    format!(
        "{} {} {:?} {:?}",
        segmenter.name(),
        segmenter.basis(),
        frame.image,
        frame.depth
    )
}

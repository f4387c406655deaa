//! Images of views, as the steps of depth estimation need them.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::outcome::ViewOutcome;
use crate::stereo::patchmatch::PosedImage;
use crate::stereo::raster::{raster_camera, raster_image, tones};
use ostra_frames::{Frame, FrameError, FrameStore};

/// The images in use, as pyramids; the latest used are cached up to a budget.
///
/// Images that cannot be used are remembered, so that they are tried once.
pub struct ImagePyramids<'a> {
    frames: &'a [Frame],
    store: &'a FrameStore,
    max_side: u32,
    coarsest_px: u32,
    budget_bytes: usize,
    kept: BTreeMap<usize, (u64, Arc<PosedImage>)>,
    unusable: BTreeMap<usize, ViewOutcome>,
    clock: u64,
}

impl<'a> ImagePyramids<'a> {
    /// Creates an empty cache.
    pub fn new(
        frames: &'a [Frame],
        store: &'a FrameStore,
        max_side: u32,
        coarsest_px: u32,
        budget_bytes: usize,
    ) -> Self {
        Self {
            frames,
            store,
            max_side,
            coarsest_px,
            budget_bytes,
            kept: BTreeMap::new(),
            unusable: BTreeMap::new(),
            clock: 0,
        }
    }

    /// Returns the image of a frame.
    ///
    /// # Errors
    /// Returns the outcome for its view, if the frame has no camera, or its image cannot be read or
    /// is of one colour.
    pub fn get(&mut self, number: usize) -> Result<Arc<PosedImage>, ViewOutcome> {
        if let Some(outcome) = self.unusable.get(&number) {
            return Err(outcome.clone());
        }
        self.read(number)
            .inspect_err(|outcome| self.leave_out(number, outcome.clone()))
    }

    /// Gives a view its outcome; its image is not used any more.
    pub fn leave_out(&mut self, number: usize, outcome: ViewOutcome) {
        self.unusable.insert(number, outcome);
    }

    /// Returns the outcomes of views whose images cannot be used, as far as they were tried.
    pub fn unusable(&self) -> &BTreeMap<usize, ViewOutcome> {
        &self.unusable
    }

    fn read(&mut self, number: usize) -> Result<Arc<PosedImage>, ViewOutcome> {
        self.clock += 1;
        if let Some((used, image)) = self.kept.get_mut(&number) {
            *used = self.clock;
            return Ok(Arc::clone(image));
        }
        let frame = &self.frames[number];
        let (lens, pose) = frame.posed_camera().ok_or(ViewOutcome::NoCamera)?;
        let unreadable = |error: FrameError| ViewOutcome::Unreadable {
            why: error.to_string(),
        };
        let image = raster_image(frame, lens, self.store, self.max_side).map_err(unreadable)?;
        let camera = raster_camera(lens, self.max_side);
        let image = Arc::new(PosedImage::new(
            tones(&image),
            camera,
            *pose,
            self.coarsest_px,
        ));
        if image.is_constant {
            return Err(ViewOutcome::Constant);
        }
        self.make_room(image.bytes());
        self.kept.insert(number, (self.clock, Arc::clone(&image)));
        Ok(image)
    }

    /// Returns the longer side of the raster.
    pub fn max_side(&self) -> u32 {
        self.max_side
    }

    fn make_room(&mut self, bytes: usize) {
        let held = |kept: &BTreeMap<usize, (u64, Arc<PosedImage>)>| {
            kept.values().map(|(_, image)| image.bytes()).sum::<usize>()
        };
        while !self.kept.is_empty() && held(&self.kept) + bytes > self.budget_bytes {
            let oldest = self
                .kept
                .iter()
                .min_by_key(|(_, (used, _))| *used)
                .map(|(&number, _)| number);
            self.kept.remove(&oldest.unwrap_or_default());
        }
    }
}

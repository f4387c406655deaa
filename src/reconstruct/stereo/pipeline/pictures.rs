use std::collections::BTreeMap;
use std::sync::Arc;

use crate::stereo::patchmatch::Picture;
use crate::stereo::raster::{raster_camera, raster_image, tones};
use ostra_frames::{Frame, FrameStore};

/// The pictures that are worked on, as pyramids; the latest used are kept up to a budget.
pub struct Pictures<'a> {
    frames: &'a [Frame],
    store: &'a FrameStore,
    max_side: u32,
    coarsest_px: u32,
    budget_bytes: usize,
    kept: BTreeMap<usize, (u64, Arc<Picture>)>,
    clock: u64,
}

impl<'a> Pictures<'a> {
    /// None kept yet.
    pub fn new(
        frames: &'a [Frame],
        store: &'a FrameStore,
        (max_side, coarsest_px): (u32, u32),
        budget_bytes: usize,
    ) -> Self {
        Self {
            frames,
            store,
            max_side,
            coarsest_px,
            budget_bytes,
            kept: BTreeMap::new(),
            clock: 0,
        }
    }

    /// The picture of a frame with a posed camera.
    ///
    /// # Errors
    /// What reading it said.
    pub fn get(&mut self, number: usize) -> Result<Arc<Picture>, String> {
        self.clock += 1;
        if let Some((used, picture)) = self.kept.get_mut(&number) {
            *used = self.clock;
            return Ok(Arc::clone(picture));
        }
        let frame = &self.frames[number];
        let (lens, pose) = frame
            .posed_camera()
            .ok_or_else(|| format!("frame '{}' has no camera", frame.name))?;
        let image = raster_image(frame, lens, self.store, self.max_side)
            .map_err(|error| error.to_string())?;
        let camera = raster_camera(lens, self.max_side);
        let picture = Arc::new(Picture::new(tones(&image), camera, *pose, self.coarsest_px));
        self.make_room(picture.bytes());
        self.kept.insert(number, (self.clock, Arc::clone(&picture)));
        Ok(picture)
    }

    /// Longer side of the raster.
    pub fn max_side(&self) -> u32 {
        self.max_side
    }

    fn make_room(&mut self, bytes: usize) {
        let held = |kept: &BTreeMap<usize, (u64, Arc<Picture>)>| {
            kept.values()
                .map(|(_, picture)| picture.bytes())
                .sum::<usize>()
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

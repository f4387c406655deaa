use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use ostra_core::job::{Progress, Stopped};
use ostra_frames::{FrameError, Image};
use ostra_masks::{MaskError, TrackRequest};

/// Frames and bytes that a walk backwards loads together, in rising order: a film is decoded forwards only.
const BLOCK: usize = 16;
const BLOCK_BYTES: usize = 128 << 20;

/// The most frames that a warning names.
const NAMED: usize = 5;

/// The pictures of a request. Frames that cannot be read are noted and passed over.
pub(super) struct Pictures<'a> {
    request: &'a TrackRequest,
    progress: &'a Progress,
    unread: BTreeMap<usize, FrameError>,
}

impl<'a> Pictures<'a> {
    pub fn new(request: &'a TrackRequest, progress: &'a Progress) -> Self {
        Self {
            request,
            progress,
            unread: BTreeMap::new(),
        }
    }

    fn load(&mut self, frame: usize) -> Result<Option<Arc<Image>>, Stopped> {
        self.progress.check()?;
        let loaded = self.request.store.image(&self.request.frames[frame]);
        Ok(loaded
            .map_err(|error| drop(self.unread.insert(frame, error)))
            .ok())
    }

    /// The first of the frames that could not be read, as an error.
    pub fn failure(&mut self) -> Option<MaskError> {
        self.unread.pop_first().map(|(_, error)| error.into())
    }

    /// Lines that name the frames which could not be read, those of the `missed` ones that could but come before any anchor
    /// that can be read, and those of another size than any anchor.
    pub fn warnings(&self, missed: &[usize], others: &[usize]) -> Vec<String> {
        let mut lines = Vec::new();
        if let Some(first) = self.unread.values().next() {
            let named = self.named(&self.unread.keys().copied().collect::<Vec<_>>());
            lines.push(format!(
                "{} frames cannot be read and were stepped over: {named} ({first})",
                self.unread.len()
            ));
        }
        let missed: Vec<usize> = missed
            .iter()
            .copied()
            .filter(|frame| !self.unread.contains_key(frame))
            .collect();
        if !missed.is_empty() {
            let (named, count) = (self.named(&missed), missed.len());
            lines.push(format!(
                "{count} frames were left out, as the mask before them lies on an unreadable frame: {named}"
            ));
        }
        if !others.is_empty() {
            let named = self.named(others);
            let count = others.len();
            lines.push(format!(
                "{count} frames have pictures of another size than any frame with a mask and were left out: {named}; \
                 make a mask on one of them"
            ));
        }
        lines
    }

    fn named(&self, frames: &[usize]) -> String {
        let names = frames
            .iter()
            .take(NAMED)
            .map(|&frame| self.request.frames[frame].name.as_str());
        let names = names.collect::<Vec<_>>().join(", ");
        let more = frames.len().checked_sub(NAMED).filter(|&more| more > 0);
        more.map_or(names.clone(), |more| format!("{names} and {more} more"))
    }
}

/// The pictures along a walk, in its order.
pub(super) struct Loading {
    count: usize,
    coming: VecDeque<usize>,
    loaded: VecDeque<(usize, Arc<Image>)>,
}

impl Loading {
    pub fn new(frames: &[usize]) -> Self {
        Self {
            count: frames.len(),
            coming: frames.iter().copied().collect(),
            loaded: VecDeque::new(),
        }
    }

    /// Frames that were handed on or stepped over.
    pub fn walked(&self) -> usize {
        self.count - self.coming.len() - self.loaded.len()
    }

    /// The next frame that can be read, with its picture; `None` at the end.
    pub fn next(
        &mut self,
        pictures: &mut Pictures<'_>,
    ) -> Result<Option<(usize, Arc<Image>)>, Stopped> {
        while self.loaded.is_empty()
            && let Some(&first) = self.coming.front()
        {
            let frame = &pictures.request.frames[first];
            let most = BLOCK_BYTES / (3 * frame.width as usize * frame.height as usize).max(1);
            let falling = 1 + self
                .coming
                .iter()
                .zip(self.coming.iter().skip(1))
                .take_while(|(a, b)| a > b)
                .count();
            let block: Vec<usize> = self
                .coming
                .drain(..falling.min(most.clamp(1, BLOCK)))
                .collect();
            for &frame in block.iter().rev() {
                let picture = pictures.load(frame)?;
                self.loaded.extend(picture.map(|picture| (frame, picture)));
            }
        }
        // Of several the first was loaded last.
        Ok(self.loaded.pop_back())
    }
}

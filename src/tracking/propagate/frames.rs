use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use super::pass_result::KeptResult;
use super::plan::{KeyframeInterval, Pass, Section};
use ostra_core::job::{Progress, Stopped};
use ostra_frames::{FrameError, Image};
use ostra_masks::{LabelMask, MaskError, TrackRequest};

/// Limits on the frames and bytes that a backward pass reads as one block.
///
/// A block is read in ascending order, because a video is decoded forward only.
const BLOCK_FRAMES: usize = 16;
const BLOCK_BYTES: usize = 128 << 20;

/// Maximum number of frame names in a warning.
const MOST_NAMED: usize = 5;

/// One frame of a pass with its image.
#[derive(Debug, Clone)]
pub(crate) struct PassFrame {
    pub index: usize,
    pub image: Arc<Image>,
}

/// Reads the images of a request. Unreadable frames are noted and skipped.
pub(super) struct FrameReader<'a> {
    request: &'a TrackRequest,
    progress: &'a Progress,
    unread: BTreeMap<usize, FrameError>,
}

impl<'a> FrameReader<'a> {
    pub fn new(request: &'a TrackRequest, progress: &'a Progress) -> Self {
        Self {
            request,
            progress,
            unread: BTreeMap::new(),
        }
    }

    /// Reads a frame's image; `None` if it cannot be read.
    pub fn read(&mut self, index: usize) -> Result<Option<PassFrame>, Stopped> {
        self.progress.check()?;
        let image = self.request.store.image(&self.request.frames[index]);
        Ok(image
            .map(|image| PassFrame { index, image })
            .map_err(|error| drop(self.unread.insert(index, error)))
            .ok())
    }

    /// Returns the error of the first frame that could not be read.
    pub fn failure(&mut self) -> Option<MaskError> {
        self.unread.pop_first().map(|(_, error)| error.into())
    }

    /// Returns one line for each kind of skipped frame.
    ///
    /// These are unreadable frames, readable frames of `missed`, and frames whose size differs from
    /// that of all keyframes. Frames in `missed` come before any readable keyframe.
    pub fn warnings(&self, missed: &[usize], other_sizes: &[usize]) -> Vec<String> {
        let mut lines = Vec::new();
        if let Some(first) = self.unread.values().next() {
            let named = self.named(&self.unread.keys().copied().collect::<Vec<_>>());
            lines.push(format!(
                "{} frames cannot be read and were stepped over: {named} ({first})",
                self.unread.len()
            ));
        }
        let is_read = |frame: &usize| !self.unread.contains_key(frame);
        let missed: Vec<usize> = missed.iter().copied().filter(is_read).collect();
        if !missed.is_empty() {
            let (named, count) = (self.named(&missed), missed.len());
            lines.push(format!(
                "{count} frames were left out, as the mask before them lies on an unreadable frame: {named}"
            ));
        }
        if !other_sizes.is_empty() {
            let (named, count) = (self.named(other_sizes), other_sizes.len());
            lines.push(format!(
                "{count} frames have images of another size than any frame with a mask and were left out: {named}; \
                 make a mask on one of them"
            ));
        }
        lines
    }

    fn named(&self, frames: &[usize]) -> String {
        let names = frames
            .iter()
            .take(MOST_NAMED)
            .map(|&frame| self.request.frames[frame].name.as_str());
        let names = names.collect::<Vec<_>>().join(", ");
        let more = frames
            .len()
            .checked_sub(MOST_NAMED)
            .filter(|&more| more > 0);
        more.map_or(names.clone(), |more| format!("{names} and {more} more"))
    }

    /// Returns how many of the next frames are read as one block.
    fn block_length(&self, coming: &VecDeque<usize>) -> usize {
        let Some(&first) = coming.front() else {
            return 0;
        };
        let frame = &self.request.frames[first];
        let most = BLOCK_BYTES / (3 * frame.width as usize * frame.height as usize).max(1);
        let pairs = coming.iter().zip(coming.iter().skip(1));
        let falling = 1 + pairs.take_while(|(a, b)| a > b).count();
        falling.min(most.clamp(1, BLOCK_FRAMES))
    }
}

/// The frames of a pass that are still to come.
pub(super) struct Upcoming {
    count: usize,
    /// Not read yet.
    coming: VecDeque<usize>,
    /// Read as a block, the next one last.
    block: Vec<PassFrame>,
    /// Read ahead of their turn.
    peeked: VecDeque<PassFrame>,
}

impl Upcoming {
    pub fn new(frames: impl Iterator<Item = usize>) -> Self {
        let coming: VecDeque<usize> = frames.collect();
        Self {
            count: coming.len(),
            coming,
            block: Vec::new(),
            peeked: VecDeque::new(),
        }
    }

    /// Returns the number of frames that were taken or skipped as unreadable.
    pub fn passed(&self) -> usize {
        self.count - self.coming.len() - self.block.len() - self.peeked.len()
    }

    /// Returns whether a keyframe is still to come.
    pub fn has_keyframe(&self, section: &Section) -> bool {
        let read = self
            .block
            .iter()
            .chain(&self.peeked)
            .map(|frame| frame.index);
        let mut all = read.chain(self.coming.iter().copied());
        all.any(|frame| section.keyframes.contains_key(&frame))
    }

    /// Takes the next readable frame; `None` at the end.
    pub fn next(&mut self, reader: &mut FrameReader<'_>) -> Result<Option<PassFrame>, Stopped> {
        match self.peeked.pop_front() {
            Some(frame) => Ok(Some(frame)),
            None => self.read_next(reader),
        }
    }

    /// Returns the frame `place` frames after the next one, without taking it.
    fn peek(
        &mut self,
        place: usize,
        reader: &mut FrameReader<'_>,
    ) -> Result<Option<PassFrame>, Stopped> {
        while self.peeked.len() <= place {
            match self.read_next(reader)? {
                Some(frame) => self.peeked.push_back(frame),
                None => return Ok(None),
            }
        }
        Ok(self.peeked.get(place).cloned())
    }

    fn read_next(&mut self, reader: &mut FrameReader<'_>) -> Result<Option<PassFrame>, Stopped> {
        while self.block.is_empty() && !self.coming.is_empty() {
            let length = reader.block_length(&self.coming);
            let frames: Vec<usize> = self.coming.drain(..length).collect();
            for &frame in frames.iter().rev() {
                self.block.extend(reader.read(frame)?);
            }
        }
        Ok(self.block.pop())
    }
}

/// Masks of frames that an engine has not reached yet.
///
/// These are the mask of the keyframe at the end of the pass, and the results of the pass that came
/// from there.
pub(super) struct KnownMasks<'a> {
    pub section: &'a Section,
    pub pass: &'a Pass,
    pub kept: &'a BTreeMap<usize, KeptResult>,
}

/// Mask of a frame ahead.
pub(crate) struct KnownMask {
    /// The mask, at the size of the engine's results; a keyframe's has the size of its image.
    pub mask: LabelMask,
    /// Weight relative to the mask of the frame before, 0–1.
    pub share: f32,
}

impl KnownMasks<'_> {
    pub fn get(&self, frame: usize) -> Option<LabelMask> {
        if self.pass.far_keyframe == Some(frame) {
            return Some(LabelMask::clone(&self.section.keyframes[&frame]));
        }
        self.kept.get(&frame).map(KeptResult::mask)
    }
}

/// Access of an engine to the frames after the one it propagates masks to.
pub(crate) struct LookAhead<'a, 'r> {
    pub(super) upcoming: &'a mut Upcoming,
    pub(super) reader: &'a mut FrameReader<'r>,
    pub(super) known: KnownMasks<'a>,
    pub(super) interval: Option<KeyframeInterval>,
    /// The frame that the masks come from.
    pub(super) previous: usize,
}

impl LookAhead<'_, '_> {
    /// Returns the frame `place` frames after the next one; `None` beyond the end of the pass.
    ///
    /// # Errors
    /// [`MaskError::Stopped`] if the user stops the job.
    pub fn frame(&mut self, place: usize) -> Result<Option<PassFrame>, MaskError> {
        Ok(self.upcoming.peek(place, self.reader)?)
    }

    /// Returns the mask of a frame ahead, if it is known.
    pub fn mask(&self, frame: usize) -> Option<KnownMask> {
        let mask = self.known.get(frame)?;
        let share = self.interval?.share_of(frame, self.previous);
        Some(KnownMask { mask, share })
    }
}

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Weak};

use super::memory::Describer;
use super::picture::Picture;
use ostra_core::job::Progress;
use ostra_frames::FrameError;
use ostra_masks::{MaskError, TrackRequest};

/// Frames that a walk backwards loads together, in rising order: a film is decoded forwards only.
const BLOCK: usize = 16;

/// The most unread frames that a warning names.
const NAMED: usize = 5;

/// The pictures of a request, each at the size that is asked for. Frames that cannot be read are noted and passed over.
pub(super) struct Pictures<'a> {
    request: &'a TrackRequest,
    progress: &'a Progress,
    describer: Option<&'a dyn Describer>,
    /// Those that somebody may still hold, by frame.
    made: BTreeMap<usize, Weak<Picture>>,
    unread: BTreeMap<usize, FrameError>,
}

impl<'a> Pictures<'a> {
    /// The pictures of this request's frames.
    pub fn new(
        request: &'a TrackRequest,
        describer: Option<&'a dyn Describer>,
        progress: &'a Progress,
    ) -> Self {
        Self {
            request,
            progress,
            describer,
            made: BTreeMap::new(),
            unread: BTreeMap::new(),
        }
    }

    /// A frame's picture, the same one as long as somebody holds it; `None` where it cannot be read.
    pub fn load(
        &mut self,
        frame: usize,
        size: (usize, usize),
    ) -> Result<Option<Arc<Picture>>, MaskError> {
        self.progress.check()?;
        let held = self.made.get(&frame).and_then(Weak::upgrade);
        if let Some(picture) = held.filter(|picture| (picture.width, picture.height) == size) {
            return Ok(Some(picture));
        }
        let image = match self.request.store.image(&self.request.frames[frame]) {
            Ok(image) => image,
            Err(error) => {
                self.unread.insert(frame, error);
                return Ok(None);
            }
        };
        let picture = Picture::new(&image, size);
        let picture = Arc::new(match self.describer {
            Some(describer) => picture.described(describer)?,
            None => picture,
        });
        self.made.retain(|_, picture| picture.strong_count() > 0);
        self.made.insert(frame, Arc::downgrade(&picture));
        Ok(Some(picture))
    }

    /// The first of the frames that could not be read, as an error.
    pub fn failure(&mut self) -> Option<MaskError> {
        self.unread.pop_first().map(|(_, error)| error.into())
    }

    /// One line that names the frames which could not be read.
    pub fn warnings(&self) -> Vec<String> {
        let Some(first) = self.unread.values().next() else {
            return Vec::new();
        };
        let names: Vec<&str> = self
            .unread
            .keys()
            .map(|&frame| self.request.frames[frame].name.as_str())
            .collect();
        let more = names.len().checked_sub(NAMED).filter(|&more| more > 0);
        let more = more.map_or_else(String::new, |more| format!(" and {more} more"));
        let named = names[..names.len().min(NAMED)].join(", ");
        vec![format!(
            "{} frames cannot be read and were stepped over: {named}{more} ({first})",
            names.len()
        )]
    }
}

/// The pictures along a walk, in its order.
pub(super) struct Route {
    size: (usize, usize),
    /// How many frames are loaded together.
    block: usize,
    coming: VecDeque<usize>,
    loaded: VecDeque<(usize, Arc<Picture>)>,
}

impl Route {
    /// From the frame next to `start` to `last`, which lies before or after it.
    pub fn new(start: usize, last: usize, size: (usize, usize)) -> Self {
        let forwards = last > start;
        let coming = if forwards {
            (start + 1..=last).collect()
        } else {
            (last..start).rev().collect()
        };
        Self {
            size,
            block: if forwards { 1 } else { BLOCK },
            coming,
            loaded: VecDeque::new(),
        }
    }

    /// The next frame that can be read, with its picture; `None` at the end.
    pub fn next(
        &mut self,
        pictures: &mut Pictures<'_>,
    ) -> Result<Option<(usize, Arc<Picture>)>, MaskError> {
        while self.loaded.is_empty() && !self.coming.is_empty() {
            let mut block: Vec<usize> = self
                .coming
                .drain(..self.block.min(self.coming.len()))
                .collect();
            block.sort_unstable();
            for frame in block {
                let picture = pictures.load(frame, self.size)?;
                self.loaded.extend(picture.map(|picture| (frame, picture)));
            }
        }
        // A block of several lies in rising order and is walked from its end.
        Ok(self.loaded.pop_back())
    }
}

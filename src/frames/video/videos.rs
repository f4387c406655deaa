use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, LazyLock, Mutex, MutexGuard, PoisonError};

use super::probe::Stream;
use super::programs::{Programs, input};
use super::search::{Damage, FrameRequest, Knowledge, Running, Target, read_frame};
use crate::{FrameError, Image};
use ostra_core::job::Progress;

/// Bounds of the number of concurrent ffmpeg processes.
///
/// There is one for each thread that reads a part of a video.
const DECODERS: std::ops::RangeInclusive<usize> = 4..=16;

/// Maximum number of images to read over with a running decoder; beyond it, a restart is faster.
const MAX_SKIP: u64 = 60;

/// Bytes of images that all decoders together may decode ahead (each at least one image).
const AHEAD_BYTES: usize = 64 << 20;

/// Number of decoders on this machine.
static MAX_DECODERS: LazyLock<usize> = LazyLock::new(|| {
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    cores.clamp(*DECODERS.start(), *DECODERS.end())
});

/// Videos being read by a few running decoders, each of which continues from its position.
#[derive(Debug, Default)]
pub(crate) struct Videos {
    programs: Programs,
    state: Mutex<VideosState>,
    changed: Condvar,
    /// Knowledge about each video that was read.
    known: Mutex<BTreeMap<PathBuf, Arc<Mutex<Knowledge>>>>,
}

#[derive(Debug, Default)]
struct VideosState {
    slots: Vec<DecoderSlot>,
    clock: u64,
}

/// A decoder, or its reserved slot while a thread reads from it.
#[derive(Debug)]
struct DecoderSlot {
    id: u64,
    video: PathBuf,
    /// Index of the next image after the current read.
    next: u64,
    used: u64,
    /// `None` while a thread reads from it.
    decoder: Option<Running>,
}

/// Damage found while reading that was not yet taken.
static DAMAGE: Mutex<Vec<String>> = Mutex::new(Vec::new());

/// Returns the damage that ffmpeg found in videos since the last call, one line per video.
#[must_use]
pub fn take_video_damage() -> Vec<String> {
    std::mem::take(&mut *DAMAGE.lock().unwrap_or_else(PoisonError::into_inner))
}

fn report(path: &Path, damage: &Damage) {
    let Damage { index, error } = damage;
    let line = format!(
        "{}: damaged at or before frame {index} ({error}); what the frames from there on show may be wrong: replace the \
         file or leave these frames out",
        path.display()
    );
    DAMAGE
        .lock()
        .unwrap_or_else(PoisonError::into_inner)
        .push(line);
}

impl Videos {
    /// Decodes frame `index` of a video, which is at `time_s` seconds from its start.
    ///
    /// `bytes` is the approximate size of the decoded frame.
    pub fn read(
        &self,
        video: &Path,
        index: u64,
        time_s: f64,
        bytes: usize,
    ) -> Result<Image, FrameError> {
        input(video)?;
        let known = self.knowledge(video)?;
        let has_reliable_seeks = known
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .has_reliable_seeks();
        let mut lease = self.lease(
            video,
            index,
            if has_reliable_seeks {
                MAX_SKIP
            } else {
                u64::MAX
            },
        );
        let ahead = (AHEAD_BYTES / *MAX_DECODERS / bytes.max(1)).clamp(1, 16);
        let mut mine = known.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let had_damage = mine.damage.is_some();
        let running = lease.decoder.take();
        let request = FrameRequest {
            target: Target { index, time_s },
            ahead,
        };
        let read = read_frame(&self.programs, video, running, request, &mut mine);
        {
            let mut shared = known.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some(damage) = mine
                .damage
                .as_ref()
                .filter(|_| !had_damage && shared.damage.is_none())
            {
                report(video, damage);
            }
            shared.learn_from(mine);
        }
        let (image, running) = read?;
        lease.decoder = Some(running);
        Ok(image)
    }

    fn knowledge(&self, video: &Path) -> Result<Arc<Mutex<Knowledge>>, FrameError> {
        let locked = || self.known.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = locked().get(video) {
            return Ok(known.clone());
        }
        let mut stream = Stream::read(&self.programs, video, &Progress::default())?;
        stream.check_times(&self.programs, video, &Progress::default())?;
        let new = || Arc::new(Mutex::new(Knowledge::new(stream)));
        Ok(locked().entry(video.into()).or_insert_with(new).clone())
    }

    /// Waits for a lease to read the image, with a decoder that reaches it soon or without one.
    fn lease(&self, video: &Path, index: u64, max_skip: u64) -> Lease<'_> {
        let mut state = self.lock();
        loop {
            match state.slot_for(video, index, max_skip) {
                Some(at) => {
                    let slot = &mut state.slots[at];
                    if let Some(decoder) = slot.decoder.take() {
                        let decoder = Some(decoder);
                        slot.next = index + 1;
                        return Lease {
                            videos: self,
                            id: slot.id,
                            decoder,
                        };
                    }
                }
                None => {
                    if let Some((id, ended)) = state.new_slot(video, index) {
                        drop(state);
                        drop(ended); // ending a process takes time
                        return Lease {
                            videos: self,
                            id,
                            decoder: None,
                        };
                    }
                }
            }
            state = self
                .changed
                .wait(state)
                .unwrap_or_else(PoisonError::into_inner);
        }
    }

    fn lock(&self) -> MutexGuard<'_, VideosState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl VideosState {
    /// Returns the slot whose decoder reaches the frame soonest.
    ///
    /// Waiting for a decoder that another thread uses is only worthwhile if it is near.
    fn slot_for(&self, video: &Path, index: u64, max_skip: u64) -> Option<usize> {
        let fits = |slot: &DecoderSlot| {
            let skip = if slot.decoder.is_some() {
                max_skip
            } else {
                MAX_SKIP
            };
            slot.video == video && slot.next <= index && index - slot.next <= skip
        };
        let fitting = self.slots.iter().enumerate().filter(|(_, slot)| fits(slot));
        fitting
            .max_by_key(|(_, slot)| (slot.next, slot.decoder.is_some()))
            .map(|(at, _)| at)
    }

    /// Returns a slot for a new decoder and the one it replaces; `None` if all are in use.
    fn new_slot(&mut self, video: &Path, index: u64) -> Option<(u64, Option<DecoderSlot>)> {
        let mut ended = None;
        if self.slots.len() >= *MAX_DECODERS {
            let idle = self
                .slots
                .iter()
                .enumerate()
                .filter(|(_, slot)| slot.decoder.is_some());
            let oldest = idle.min_by_key(|(_, slot)| slot.used).map(|(at, _)| at)?;
            ended = Some(self.slots.swap_remove(oldest));
        }
        self.clock += 1;
        let id = self.clock;
        self.slots.push(DecoderSlot {
            id,
            video: video.into(),
            next: index + 1,
            used: id,
            decoder: None,
        });
        Some((id, ended))
    }
}

/// Exclusive use of one decoder by one thread.
///
/// The decoder returns to its slot afterwards; without a decoder, the slot is removed.
struct Lease<'a> {
    videos: &'a Videos,
    id: u64,
    /// Running decoder, if there is one.
    decoder: Option<Running>,
}

impl Drop for Lease<'_> {
    fn drop(&mut self) {
        let mut state = self.videos.lock();
        state.clock += 1;
        let now = state.clock;
        if let Some(at) = state.slots.iter().position(|slot| slot.id == self.id) {
            match self.decoder.take() {
                Some(decoder) => {
                    (state.slots[at].decoder, state.slots[at].used) = (Some(decoder), now);
                }
                None => drop(state.slots.swap_remove(at)),
            }
        }
        drop(state);
        self.videos.changed.notify_all();
    }
}

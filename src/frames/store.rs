//! Images and depth of frames through bounded caches, with work ahead in the background.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use super::image::shrink;
use super::loader::{Key, Loader, depth_bytes, picture_bytes};
use super::{DepthMap, Frame, FrameError, Image, MadeDepth, PictureSource};
use ostra_core::cache::Cache;
use ostra_core::job::{Pool, Progress, Stopped};

/// Bytes of thumbnails that are kept.
const THUMBNAIL_BYTES: usize = 32 << 20;

/// Loads images and depths on demand and keeps the latest in a cache bounded in bytes. Shared by all threads: none
/// decodes what another is decoding already, and all wait only for what they asked for.
#[derive(Debug)]
pub struct FrameStore {
    loader: Arc<Loader>,
    budget_bytes: usize,
    thumbnails: Arc<Cache<(Key, u32), Arc<Image>>>,
    ahead: Background,
    thumbnails_ahead: Background,
}

impl FrameStore {
    /// A store that keeps at most `budget_bytes` of decoded pixels, and 32 MiB of thumbnails besides.
    #[must_use]
    pub fn new(budget_bytes: usize) -> Self {
        Self::at_home(budget_bytes, PathBuf::new())
    }

    /// As [`Self::new`]; depths that a reconstruction made are looked for below the folder `home`.
    #[must_use]
    pub fn at_home(budget_bytes: usize, home: PathBuf) -> Self {
        let threads =
            std::thread::available_parallelism().map_or(1, |cores| cores.get().div_ceil(2).min(4));
        Self {
            loader: Arc::new(Loader::new(budget_bytes, home)),
            budget_bytes,
            thumbnails: Arc::new(Cache::new(THUMBNAIL_BYTES)),
            ahead: Background::new("prefetch", threads),
            thumbnails_ahead: Background::new("thumbnails", threads),
        }
    }

    /// Bytes of decoded pixels kept now, thumbnails not counted; never above the budget.
    #[must_use]
    pub fn bytes_kept(&self) -> usize {
        self.loader.bytes()
    }

    /// The frame's image, turned upright. An image larger than the budget is decoded again each time.
    ///
    /// # Errors
    /// [`FrameError`] when the source is missing, damaged or of another size than when it was opened.
    pub fn image(&self, frame: &Frame) -> Result<Arc<Image>, FrameError> {
        self.loader.image(frame)
    }

    /// The frame's image if it is decoded already; never waits for decoding.
    #[must_use]
    pub fn cached_image(&self, frame: &Frame) -> Option<Arc<Image>> {
        self.loader.cached_image(frame)
    }

    /// Which pixels of the frame's image are opaque, leaving out those next to a transparent one: `width · height` values,
    /// row by row; `None` where all are. [`Self::image`] shows transparent pixels in grey.
    ///
    /// # Errors
    /// As [`Self::image`].
    pub fn opaque_pixels(&self, frame: &Frame) -> Result<Option<Vec<bool>>, FrameError> {
        self.loader.opaque_pixels(frame)
    }

    /// The frame's depth in world units, turned upright; `None` when it has none.
    ///
    /// # Errors
    /// As [`Self::image`].
    pub fn depth(&self, frame: &Frame) -> Result<Option<Arc<DepthMap>>, FrameError> {
        self.loader.depth(frame)
    }

    /// The depth map that a reconstruction made for the frame, at its own size; `None` where it has none. Not kept.
    ///
    /// # Errors
    /// As [`Self::image`].
    pub fn made_depth(&self, frame: &Frame) -> Result<Option<MadeDepth>, FrameError> {
        self.loader.made_depth(frame)
    }

    /// Decodes images and depths in the background, the first first, until half the budget is spent on them. The
    /// newest call wins: what an earlier one left undone is forgotten. Errors come when the frame is asked for.
    pub fn prefetch(&self, frames: &[Frame]) {
        let mut bytes = 0;
        let fitting = frames.iter().take_while(|frame| {
            bytes += picture_bytes(frame) + depth_bytes(frame);
            bytes <= self.budget_bytes / 2
        });
        let fitting: Vec<Frame> = fitting.cloned().collect();
        let tasks = fitting.chunk_by(in_one_film).map(|frames| {
            let (loader, frames) = (Arc::clone(&self.loader), frames.to_vec());
            move |progress: &Progress| {
                let _ = each(&frames, progress, |frame| {
                    let _ = (loader.image(frame), loader.depth(frame));
                });
            }
        });
        self.ahead.replace(tasks);
    }

    /// The frame's image with at most `max_side` pixels on its longer side, turned upright; never enlarged.
    ///
    /// # Errors
    /// As [`Self::image`].
    pub fn thumbnail(&self, frame: &Frame, max_side: u32) -> Result<Arc<Image>, FrameError> {
        thumbnail(&self.loader, &self.thumbnails, frame, max_side)
    }

    /// The thumbnail if it is made already; never waits for decoding.
    #[must_use]
    pub fn cached_thumbnail(&self, frame: &Frame, max_side: u32) -> Option<Arc<Image>> {
        self.thumbnails
            .peek(&(Key::of_picture(&frame.picture), max_side))
    }

    /// Makes thumbnails in the background, the first first; the newest call wins, as in [`Self::prefetch`].
    pub fn prefetch_thumbnails(&self, frames: &[Frame], max_side: u32) {
        let tasks = frames.chunk_by(in_one_film).map(|frames| {
            let (loader, thumbnails, frames) = (
                Arc::clone(&self.loader),
                Arc::clone(&self.thumbnails),
                frames.to_vec(),
            );
            move |progress: &Progress| {
                let _ = each(&frames, progress, |frame| {
                    let _ = thumbnail(&loader, &thumbnails, frame, max_side);
                });
            }
        });
        self.thumbnails_ahead.replace(tasks);
    }
}

/// The thumbnail, from the decoded image where that is kept; decoding for a thumbnail drives nothing out of the cache.
fn thumbnail(
    loader: &Loader,
    thumbnails: &Cache<(Key, u32), Arc<Image>>,
    frame: &Frame,
    max_side: u32,
) -> Result<Arc<Image>, FrameError> {
    thumbnails.get(&(Key::of_picture(&frame.picture), max_side), || {
        let image = loader
            .cached_image(frame)
            .map_or_else(|| loader.decode_image(frame), Ok)?;
        Ok(Arc::new(shrink(&image, max_side)))
    })
}

/// Images of one video are decoded by one thread in order, without seeking.
fn in_one_film(a: &Frame, b: &Frame) -> bool {
    match (&a.picture, &b.picture) {
        (PictureSource::Film { path: a, .. }, PictureSource::Film { path: b, .. }) => a == b,
        _ => false,
    }
}

fn each(frames: &[Frame], progress: &Progress, mut act: impl FnMut(&Frame)) -> Result<(), Stopped> {
    for frame in frames {
        progress.check()?;
        act(frame);
    }
    Ok(())
}

/// Most tasks of one request that are taken.
const CAPACITY: usize = 4096;

/// Work done ahead of need, in which the newest request wins: what an earlier one left undone is forgotten.
#[derive(Debug)]
pub(super) struct Background {
    name: &'static str,
    threads: usize,
    pool: OnceLock<Pool>,
    current: Mutex<Progress>,
}

impl Background {
    /// Up to `threads` threads named `name`, started when first needed.
    pub fn new(name: &'static str, threads: usize) -> Self {
        Self {
            name,
            threads,
            pool: OnceLock::new(),
            current: Mutex::default(),
        }
    }

    /// Drops what waits, stops what runs at its next step, and puts these tasks in the queue.
    pub fn replace<F: FnOnce(&Progress) + Send + 'static>(
        &self,
        tasks: impl IntoIterator<Item = F>,
    ) {
        let pool = self
            .pool
            .get_or_init(|| Pool::new(self.name, self.threads, CAPACITY));
        let mut current = self.current.lock().unwrap_or_else(PoisonError::into_inner);
        current.stop();
        *current = Progress::default();
        pool.clear();
        for task in tasks {
            if pool.submit(current.clone(), task).is_err() {
                return;
            }
        }
    }
}

impl Drop for Background {
    fn drop(&mut self) {
        self.current
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .stop();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;

    use super::*;

    #[test]
    fn the_newest_request_wins() {
        let background = Background::new("test", 1);
        let (sender, done) = channel();
        let (began, wait) = channel();
        background.replace((0..50).map(|k| {
            let (sender, began) = (sender.clone(), began.clone());
            move |progress: &Progress| {
                let _ = began.send(());
                while progress.check().is_ok() {
                    std::thread::yield_now();
                }
                let _ = sender.send(k);
            }
        }));
        wait.recv().unwrap();
        let last = sender.clone();
        background.replace([move |_: &Progress| last.send(100).unwrap()]);
        drop((sender, began));
        assert_eq!(done.iter().take(2).collect::<Vec<_>>(), [0, 100]);
    }
}

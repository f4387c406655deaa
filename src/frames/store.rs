//! Images and depth of frames through bounded caches, with prefetching in the background.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use super::image::shrink;
use super::loader::{Key, Loader, depth_bytes, image_bytes};
use super::{DepthMap, EstimatedDepth, Frame, FrameError, Image, ImageSource};
use ostra_core::cache::Cache;
use ostra_core::job::{Pool, Progress, Stopped};

/// Maximum bytes of cached thumbnails.
const THUMBNAIL_BYTES: usize = 32 << 20;

/// Loads images and depth on demand and caches the most recently used, bounded in bytes.
///
/// The store is shared by all threads. No thread decodes what another is already decoding, and each
/// waits only for its own request.
#[derive(Debug)]
pub struct FrameStore {
    loader: Arc<Loader>,
    budget_bytes: usize,
    thumbnails: Arc<Cache<(Key, u32), Arc<Image>>>,
    ahead: Background,
    thumbnails_ahead: Background,
}

impl FrameStore {
    /// Returns a store that caches at most `budget_bytes` of decoded pixels.
    ///
    /// Thumbnails take up to 32 MiB in addition.
    #[must_use]
    pub fn new(budget_bytes: usize) -> Self {
        Self::at_home(budget_bytes, PathBuf::new())
    }

    /// Returns a store as [`Self::new`] that looks for reconstructed depth below the folder `home`.
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

    /// Returns the bytes of cached pixels without thumbnails; never above the budget.
    #[must_use]
    pub fn bytes_kept(&self) -> usize {
        self.loader.bytes()
    }

    /// Returns the frame's image, rotated upright.
    ///
    /// An image larger than the budget is decoded again each time.
    ///
    /// # Errors
    ///
    /// [`FrameError`] if the source is missing, damaged or of another size than when it was opened.
    pub fn image(&self, frame: &Frame) -> Result<Arc<Image>, FrameError> {
        self.loader.image(frame)
    }

    /// Returns the frame's image if it is already decoded; never waits for decoding.
    #[must_use]
    pub fn cached_image(&self, frame: &Frame) -> Option<Arc<Image>> {
        self.loader.cached_image(frame)
    }

    /// Drops the frame's decoded image, which will not be needed again soon.
    pub fn forget_image(&self, frame: &Frame) {
        self.loader.forget_image(frame);
    }

    /// Returns whether the decoded images of all these frames fit the cache together.
    #[must_use]
    pub fn can_hold<'a>(&self, frames: impl IntoIterator<Item = &'a Frame>) -> bool {
        frames.into_iter().map(image_bytes).sum::<usize>() <= self.budget_bytes
    }

    /// Returns which pixels of the frame's image are opaque and not next to a transparent one.
    ///
    /// These are `width · height` values, row by row; `None` if all are opaque. [`Self::image`]
    /// shows transparent pixels in grey.
    ///
    /// # Errors
    ///
    /// As [`Self::image`].
    pub fn opaque_pixels(&self, frame: &Frame) -> Result<Option<Vec<bool>>, FrameError> {
        self.loader.opaque_pixels(frame)
    }

    /// Returns the frame's depth in world units, rotated upright; `None` if it has none.
    ///
    /// # Errors
    ///
    /// As [`Self::image`].
    pub fn depth(&self, frame: &Frame) -> Result<Option<Arc<DepthMap>>, FrameError> {
        self.loader.depth(frame)
    }

    /// Returns the frame's reconstructed depth map at its own size; `None` if it has none.
    ///
    /// The map is not cached.
    ///
    /// # Errors
    ///
    /// As [`Self::image`].
    pub fn estimated_depth(&self, frame: &Frame) -> Result<Option<EstimatedDepth>, FrameError> {
        self.loader.estimated_depth(frame)
    }

    /// Decodes images and depth in the background, in order, within half the budget.
    ///
    /// A new call discards the unfinished work of earlier ones. Errors are returned when the frame
    /// is requested.
    pub fn prefetch(&self, frames: &[Frame]) {
        let mut bytes = 0;
        let fitting = frames.iter().take_while(|frame| {
            bytes += image_bytes(frame) + depth_bytes(frame);
            bytes <= self.budget_bytes / 2
        });
        let fitting: Vec<Frame> = fitting.cloned().collect();
        let tasks = fitting.chunk_by(in_one_video).map(|frames| {
            let (loader, frames) = (Arc::clone(&self.loader), frames.to_vec());
            move |progress: &Progress| {
                let _ = each(&frames, progress, |frame| {
                    let _ = (loader.image(frame), loader.depth(frame));
                });
            }
        });
        self.ahead.replace(tasks);
    }

    /// Returns the frame's upright image with at most `max_side` pixels on its longer side.
    ///
    /// The image is never enlarged.
    ///
    /// # Errors
    ///
    /// As [`Self::image`].
    pub fn thumbnail(&self, frame: &Frame, max_side: u32) -> Result<Arc<Image>, FrameError> {
        thumbnail(&self.loader, &self.thumbnails, frame, max_side)
    }

    /// Returns the thumbnail if it exists already; never waits for decoding.
    #[must_use]
    pub fn cached_thumbnail(&self, frame: &Frame, max_side: u32) -> Option<Arc<Image>> {
        self.thumbnails
            .peek(&(Key::of_image(&frame.image), max_side))
    }

    /// Creates thumbnails in the background, in order.
    ///
    /// A new call discards the unfinished work of earlier ones, as in [`Self::prefetch`].
    pub fn prefetch_thumbnails(&self, frames: &[Frame], max_side: u32) {
        let tasks = frames.chunk_by(in_one_video).map(|frames| {
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

/// Returns the thumbnail, from the decoded image if that is cached.
///
/// Decoding for a thumbnail evicts nothing from the cache.
fn thumbnail(
    loader: &Loader,
    thumbnails: &Cache<(Key, u32), Arc<Image>>,
    frame: &Frame,
    max_side: u32,
) -> Result<Arc<Image>, FrameError> {
    thumbnails.get(&(Key::of_image(&frame.image), max_side), || {
        let image = loader
            .cached_image(frame)
            .map_or_else(|| loader.decode_image(frame), Ok)?;
        Ok(Arc::new(shrink(&image, max_side)))
    })
}

/// Returns whether both frames are images of one video.
///
/// One thread decodes these in order, without seeking.
fn in_one_video(a: &Frame, b: &Frame) -> bool {
    match (&a.image, &b.image) {
        (ImageSource::Video { path: a, .. }, ImageSource::Video { path: b, .. }) => a == b,
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

/// Maximum number of tasks of one request.
const CAPACITY: usize = 4096;

/// Work done in advance; a new request discards the unfinished work of earlier ones.
#[derive(Debug)]
pub(super) struct Background {
    name: &'static str,
    threads: usize,
    pool: OnceLock<Pool>,
    current: Mutex<Progress>,
}

impl Background {
    /// Returns a pool of up to `threads` threads named `name`, started on first use.
    pub fn new(name: &'static str, threads: usize) -> Self {
        Self {
            name,
            threads,
            pool: OnceLock::new(),
            current: Mutex::default(),
        }
    }

    /// Drops waiting tasks, stops running ones at their next step, and queues these tasks.
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
    fn newest_request_wins() {
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

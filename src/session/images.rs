use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use ostra_core::job::Loader;
use ostra_frames::{Frame, FrameStore, Image};

/// Maximum side of a thumbnail in pixels.
const THUMBNAIL_PX: u32 = 160;
/// Maximum side in pixels of an image shown during playback.
///
/// A screen shows little more of it, and a whole photo takes longer to draw than a frame lasts.
const PREVIEW_PX: u32 = 1280;
/// Number of previews kept: those that [`Images::play`] requests, and a few that were shown.
const PREVIEWS_KEPT: usize = 24;
/// Number of images kept at full size: the one shown and its neighbours.
const IMAGES_KEPT: usize = 3;
/// Number of thumbnails kept; at 160 × 120 pixels they take about 60 MB.
const THUMBNAILS_KEPT: usize = 1_000;

/// Images and thumbnails for display, loaded on worker threads and polled without waiting.
///
/// Current requests are loaded before earlier ones.
pub struct Images {
    loader: Loader<ImageRequest, Result<Arc<Image>, String>>,
    state: Mutex<ImagesState>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum ImageRequest {
    Full(usize),
    Preview(usize),
    Thumbnail(usize),
}

#[derive(Default)]
struct ImagesState {
    images: Shelf,
    previews: Shelf,
    thumbnails: Shelf,
    failures: BTreeMap<usize, String>,
    wanted: Vec<ImageRequest>,
    sent: Vec<ImageRequest>,
}

/// Images by frame number with the time of their last use.
///
/// The least recently used image is dropped first.
#[derive(Default)]
struct Shelf {
    kept: BTreeMap<usize, (u64, Arc<Image>)>,
    clock: u64,
}

impl Images {
    /// Loads the images of `frames` through `store`.
    ///
    /// `notify` is called on a worker's thread when an image has arrived.
    #[must_use]
    pub fn of(
        frames: Arc<Vec<Frame>>,
        store: Arc<FrameStore>,
        notify: impl Fn() + Send + Sync + 'static,
    ) -> Self {
        let load = move |number| match frames.get(number) {
            Some(frame) => store.image(frame).map_err(|error| error.to_string()),
            None => Err(format!("there is no frame {number}")),
        };
        Self::new(load, notify)
    }

    /// Like [`Self::of`], with any source of images.
    #[must_use]
    pub fn new(
        load: impl Fn(usize) -> Result<Arc<Image>, String> + Send + Sync + 'static,
        notify: impl Fn() + Send + Sync + 'static,
    ) -> Self {
        let load_request = move |request: &ImageRequest| match *request {
            ImageRequest::Full(frame) => load(frame),
            ImageRequest::Preview(frame) => load(frame).map(|image| reduced(image, PREVIEW_PX)),
            ImageRequest::Thumbnail(frame) => load(frame).map(|image| Arc::new(thumbnail(&image))),
        };
        Self {
            loader: Loader::new("pictures", 2, load_request, notify),
            state: Mutex::default(),
        }
    }

    /// Returns the frame's image if it is loaded.
    ///
    /// Requests the image, and then its neighbours.
    #[must_use]
    pub fn image(&self, frame: usize) -> Option<Arc<Image>> {
        let mut state = self.lock();
        for near in [Some(frame), frame.checked_add(1), frame.checked_sub(1)]
            .into_iter()
            .flatten()
        {
            state.ask(ImageRequest::Full(near));
        }
        state.images.peek(frame)
    }

    /// Returns the frame's thumbnail if it is loaded, and requests it.
    #[must_use]
    pub fn thumbnail(&self, frame: usize) -> Option<Arc<Image>> {
        let mut state = self.lock();
        state.ask(ImageRequest::Thumbnail(frame));
        state.thumbnails.peek(frame)
    }

    /// Requests previews for playback, most urgent first; returns those that are ready.
    ///
    /// A preview is the image with at most 1280 pixels on its longer side. A frame whose image could
    /// not be loaded is ready too, because waiting for it is in vain.
    pub fn play(&self, frames: &[usize]) -> BTreeSet<usize> {
        let mut state = self.lock();
        for &frame in frames.iter().take(PREVIEWS_KEPT) {
            state.ask(ImageRequest::Preview(frame));
            let _ = state.previews.peek(frame);
        }
        let is_ready = |frame: &&usize| !state.is_missing(ImageRequest::Preview(**frame));
        frames.iter().filter(is_ready).copied().collect()
    }

    /// Returns `true` if the preview of a frame is loaded.
    #[must_use]
    pub fn has_preview(&self, frame: usize) -> bool {
        self.lock().previews.kept.contains_key(&frame)
    }

    /// Returns the frame's image if it is loaded; requests nothing.
    #[must_use]
    pub fn kept_image(&self, frame: usize) -> Option<Arc<Image>> {
        self.lock().images.peek(frame)
    }

    /// Returns the preview of a frame if it is loaded, else its thumbnail; requests nothing.
    #[must_use]
    pub fn smaller(&self, frame: usize) -> Option<Arc<Image>> {
        let mut state = self.lock();
        let preview = state.previews.peek(frame);
        preview.or_else(|| state.thumbnails.peek(frame))
    }

    /// Returns why the frame's image could not be loaded.
    #[must_use]
    pub fn failure(&self, frame: usize) -> Option<String> {
        self.lock().failures.get(&frame).cloned()
    }

    /// Receives loaded images and sends the requests since the last call.
    ///
    /// Call it once per drawn frame.
    pub fn turn(&self) {
        let mut state = self.lock();
        for (request, result) in self.loader.take_done() {
            state.receive(request, result);
        }
        let mut wanted = std::mem::take(&mut state.wanted);
        wanted.sort_by_key(|request| match request {
            ImageRequest::Preview(_) => 0,
            ImageRequest::Full(_) => 1,
            ImageRequest::Thumbnail(_) => 2,
        });
        wanted.retain(|request| state.is_missing(*request));
        if wanted != state.sent {
            state.sent.clone_from(&wanted);
            self.loader.want(wanted);
        }
    }

    fn lock(&self) -> MutexGuard<'_, ImagesState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl ImagesState {
    fn ask(&mut self, request: ImageRequest) {
        if self.is_missing(request) && !self.wanted.contains(&request) {
            self.wanted.push(request);
        }
    }

    fn is_missing(&self, request: ImageRequest) -> bool {
        let (shelf, frame) = match request {
            ImageRequest::Full(frame) => (&self.images, frame),
            ImageRequest::Preview(frame) => (&self.previews, frame),
            ImageRequest::Thumbnail(frame) => (&self.thumbnails, frame),
        };
        !shelf.kept.contains_key(&frame) && !self.failures.contains_key(&frame)
    }

    fn receive(&mut self, request: ImageRequest, result: Result<Arc<Image>, String>) {
        self.sent.retain(|sent| *sent != request);
        match (request, result) {
            (ImageRequest::Full(frame), Ok(image)) => {
                self.images.put(frame, image, IMAGES_KEPT);
            }
            (ImageRequest::Thumbnail(frame), Ok(image)) => {
                self.thumbnails.put(frame, image, THUMBNAILS_KEPT);
            }
            (ImageRequest::Preview(frame), Ok(image)) => {
                self.previews.put(frame, image, PREVIEWS_KEPT);
            }
            (
                ImageRequest::Full(frame)
                | ImageRequest::Preview(frame)
                | ImageRequest::Thumbnail(frame),
                Err(text),
            ) => {
                self.failures.insert(frame, text);
            }
        }
    }
}

impl Shelf {
    fn peek(&mut self, frame: usize) -> Option<Arc<Image>> {
        self.clock += 1;
        let (seen, image) = self.kept.get_mut(&frame)?;
        *seen = self.clock;
        Some(Arc::clone(image))
    }

    fn put(&mut self, frame: usize, image: Arc<Image>, keep: usize) {
        self.clock += 1;
        self.kept.insert(frame, (self.clock, image));
        while self.kept.len() > keep {
            let Some(oldest) = self
                .kept
                .iter()
                .min_by_key(|(_, (seen, _))| *seen)
                .map(|(&frame, _)| frame)
            else {
                break;
            };
            self.kept.remove(&oldest);
        }
    }
}

/// Returns an image with at most `max_side` pixels on its longer side.
fn reduced(image: Arc<Image>, max_side: u32) -> Arc<Image> {
    if image.width.max(image.height) <= max_side {
        image
    } else {
        Arc::new(shrunk(&image, max_side))
    }
}

/// Reduces an image to a longer side of [`THUMBNAIL_PX`] pixels by block means.
pub(crate) fn thumbnail(image: &Image) -> Image {
    shrunk(image, THUMBNAIL_PX)
}

/// Reduces an image to a longer side of `max_side` pixels by block means; never enlarges it.
fn shrunk(image: &Image, max_side: u32) -> Image {
    let longest = image.width.max(image.height);
    if longest <= max_side {
        return image.clone();
    }
    let scaled =
        |side: u32| ((u64::from(side) * u64::from(max_side)) / u64::from(longest)).max(1) as u32;
    let (width, height) = (scaled(image.width), scaled(image.height));
    let mut pixels = Vec::with_capacity((width * height) as usize);
    for y in 0..height {
        let rows = block(y, height, image.height);
        for x in 0..width {
            pixels.push(mean(image, block(x, width, image.width), rows.clone()));
        }
    }
    Image {
        width,
        height,
        pixels,
    }
}

fn block(index: u32, of: u32, side: u32) -> std::ops::Range<u32> {
    let edge = |k: u32| (u64::from(k) * u64::from(side) / u64::from(of)) as u32;
    edge(index)..edge(index + 1).max(edge(index) + 1)
}

fn mean(image: &Image, columns: std::ops::Range<u32>, rows: std::ops::Range<u32>) -> [u8; 3] {
    let count = (columns.len() * rows.len()).max(1) as u32;
    let mut sum = [0_u32; 3];
    for y in rows {
        for x in columns.clone() {
            for (total, value) in sum.iter_mut().zip(image.at(x, y)) {
                *total += u32::from(value);
            }
        }
    }
    sum.map(|total| (total / count) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::channel;
    use std::time::Duration;

    fn image(value: u8) -> Image {
        Image {
            width: 640,
            height: 480,
            pixels: vec![[value; 3]; 640 * 480],
        }
    }

    #[test]
    fn thumbnails_keep_aspect_ratio_and_colour() {
        let small = thumbnail(&image(90));
        assert_eq!((small.width, small.height), (160, 120));
        assert!(small.pixels.iter().all(|p| *p == [90; 3]));
        let tall = thumbnail(&Image {
            width: 3,
            height: 1000,
            pixels: vec![[1, 2, 3]; 3000],
        });
        assert_eq!((tall.width, tall.height), (1, 160));
    }

    #[test]
    fn images_arrive_with_neighbours_and_failures_are_reported() {
        let (reported, notified) = channel();
        let load = |frame| {
            if frame == 9 {
                Err("gone".into())
            } else {
                Ok(Arc::new(image(frame as u8)))
            }
        };
        let images = Images::new(load, move || reported.send(()).unwrap());
        assert!(images.image(4).is_none());
        images.turn();
        while images.image(4).is_none() || images.image(5).is_none() {
            notified.recv_timeout(Duration::from_secs(60)).unwrap();
            images.turn();
        }
        assert_eq!(images.image(4).unwrap().pixels[0], [4; 3]);
        assert!(images.thumbnail(9).is_none());
        images.turn();
        while images.failure(9).is_none() {
            notified.recv_timeout(Duration::from_secs(60)).unwrap();
            // Requests are repeated in every frame, as by a panel; others are dropped.
            assert!(images.thumbnail(9).is_none());
            images.turn();
        }
        assert_eq!(images.failure(9).as_deref(), Some("gone"));
    }

    #[test]
    fn previews_are_small_and_those_that_cannot_be_loaded_are_not_waited_for() {
        let (reported, notified) = channel();
        let load = |frame: usize| match frame {
            2 => Err("gone".into()),
            _ => Ok(Arc::new(Image {
                width: 2560,
                height: 100,
                pixels: vec![[frame as u8; 3]; 256_000],
            })),
        };
        let images = Images::new(load, move || reported.send(()).unwrap());
        let frames = [0, 1, 2];
        assert!(images.play(&frames).is_empty());
        assert!(images.smaller(1).is_none());
        images.turn();
        while images.play(&frames).len() < 3 {
            notified.recv_timeout(Duration::from_secs(60)).unwrap();
            images.turn();
        }
        let preview = images.smaller(1).unwrap();
        assert_eq!((preview.width, preview.height), (1280, 50));
        assert_eq!(preview.pixels[0], [1; 3]);
        assert!(images.smaller(2).is_none());
        assert_eq!(images.failure(2).as_deref(), Some("gone"));
    }

    #[test]
    fn number_of_kept_images_is_limited() {
        let mut shelf = Shelf::default();
        for frame in 0..20 {
            shelf.put(frame, Arc::new(image(0)), 3);
            let _ = shelf.peek(0);
        }
        assert_eq!(shelf.kept.keys().copied().collect::<Vec<_>>(), [0, 18, 19]);
    }
}

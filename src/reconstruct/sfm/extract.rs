use std::borrow::Cow;
use std::collections::VecDeque;

use glam::DVec2;

use super::asift::{Original, Tilt, tilted_features};
use super::cache::{CachedExtractor, ImageKey};
use super::{Descriptors, FeatureExtractor, Features, SfmError};
use ostra_core::job::Progress;
use ostra_frames::{Frame, FrameError, FrameStore, Image, ImageSource};

/// Number of images that are decoded ahead while features of another are extracted.
const AHEAD: usize = 2;

/// Features of one image for structure from motion.
#[derive(Debug, Clone)]
pub struct ImageFeatures {
    /// Its features.
    pub features: Features,
    /// Colour of the image at each keypoint, sRGB.
    pub colors: Vec<[u8; 3]>,
    /// Why the image cannot be read; it then has no features.
    pub unreadable: Option<String>,
    /// Key of exactly these features in the cache; `None` if they are not there.
    pub(super) kept: Option<ImageKey>,
}

impl ImageFeatures {
    /// Frees the descriptors if they can be read from the cache again.
    pub(super) fn release_descriptors(&mut self) {
        if self.kept.is_some() {
            self.features.descriptors.clear();
        }
    }
}

/// Returns the allowed pixels of a frame by its number: `width · height` values row by row; `None` = all.
pub type AllowedPixels<'a> = &'a dyn Fn(usize) -> Option<Vec<bool>>;

/// Extracts features of frames, given by number.
#[derive(Clone, Copy)]
pub struct FrameFeatureExtractor<'a> {
    /// All frames of the project.
    pub frames: &'a [Frame],
    /// Reads their images.
    pub store: &'a FrameStore,
    /// Extracts features of an image.
    pub extractor: &'a dyn FeatureExtractor,
    /// The same with a cache, which keeps the features of image files.
    pub cached: Option<&'a CachedExtractor<'a>>,
    /// Pixels where features may lie.
    pub allowed: AllowedPixels<'a>,
}

/// A frame whose features are wanted.
struct WantedFrame {
    number: usize,
    allowed: Option<Vec<bool>>,
    /// Key of its image in the cache.
    key: Option<ImageKey>,
}

impl FrameFeatureExtractor<'_> {
    /// Extracts features of the chosen frames, in their order. An unreadable image has none.
    ///
    /// # Errors
    /// [`SfmError::Feature`] if the extractor fails, [`SfmError::Stopped`].
    pub fn of_frames(
        &self,
        chosen: &[usize],
        progress: &Progress,
    ) -> Result<Vec<ImageFeatures>, SfmError> {
        let mut all = Vec::with_capacity(chosen.len());
        // If not all images fit the cache, they would only displace each other.
        let keeps_images = self
            .store
            .can_hold(chosen.iter().map(|&number| &self.frames[number]));
        let mut coming = VecDeque::new();
        let mut rest = chosen.iter();
        for done in 0..chosen.len() {
            progress.step(done, chosen.len())?;
            let missing = (AHEAD + 1).saturating_sub(coming.len());
            coming.extend(rest.by_ref().take(missing).map(|&next| self.wanted(next)));
            let Some(wanted) = coming.pop_front() else {
                break;
            };
            let next = coming.iter().filter(|next| !self.is_cached(next));
            let next: Vec<Frame> = next.map(|next| self.frames[next.number].clone()).collect();
            self.store.prefetch(&next);
            all.push(self.of_wanted(&wanted)?);
            if !keeps_images {
                self.store.forget_image(&self.frames[wanted.number]);
            }
        }
        self.extractor.free_buffers();
        Ok(all)
    }

    /// Reads released descriptors from the cache again; `numbers` holds the frame of each image.
    ///
    /// Those that were removed from the cache since are extracted again.
    ///
    /// # Errors
    /// As [`Self::of_frames`].
    pub fn restore_descriptors(
        &self,
        images: &mut [ImageFeatures],
        numbers: &[usize],
    ) -> Result<(), SfmError> {
        for (image, &number) in images.iter_mut().zip(numbers) {
            let is_whole = image.features.descriptors.len() == image.features.keypoints.len();
            let Some(key) = image.kept.filter(|_| !is_whole) else {
                continue;
            };
            let frame = &self.frames[number];
            let known = self
                .cached
                .and_then(|cached| cached.image_again(&key, frame));
            let again = match known {
                Some(features) => features,
                None => self.of_frame(number)?.features,
            };
            if again.keypoints != image.features.keypoints {
                return Err(changed(frame).into());
            }
            image.features = again;
        }
        Ok(())
    }

    fn wanted(&self, number: usize) -> WantedFrame {
        let allowed = (self.allowed)(number);
        let key = self
            .cached
            .and_then(|cached| cached.image_key(&self.frames[number], allowed.as_deref()));
        WantedFrame {
            number,
            allowed,
            key,
        }
    }

    fn is_cached(&self, wanted: &WantedFrame) -> bool {
        self.cached
            .zip(wanted.key.as_ref())
            .is_some_and(|(cached, key)| cached.has_image(key))
    }

    /// Extracts features of one frame's image; none if it cannot be read.
    ///
    /// # Errors
    /// As [`Self::of_frames`].
    pub fn of_frame(&self, number: usize) -> Result<ImageFeatures, SfmError> {
        self.of_wanted(&self.wanted(number))
    }

    fn of_wanted(&self, wanted: &WantedFrame) -> Result<ImageFeatures, SfmError> {
        let frame = &self.frames[wanted.number];
        let allowed = wanted.allowed.as_deref();
        let Some((cached, key)) = self.cached.zip(wanted.key.as_ref()) else {
            return self.decoded(frame, self.extractor, allowed);
        };
        if let Some((features, colors)) = cached.image(key, frame) {
            return Ok(ImageFeatures {
                features,
                colors,
                unreadable: None,
                kept: Some(*key),
            });
        }
        // Kept once, by the file and not by its pixels.
        let mut made = self.decoded(frame, cached.extractor, allowed)?;
        if made.unreadable.is_none() {
            cached.keep_image(key, &made.features, &made.colors);
            made.kept = cached.has_image(key).then_some(*key);
        }
        Ok(made)
    }

    fn decoded(
        &self,
        frame: &Frame,
        extractor: &dyn FeatureExtractor,
        allowed: Option<&[bool]>,
    ) -> Result<ImageFeatures, SfmError> {
        let store = self.store;
        let image = match store.image(frame) {
            Ok(image) => image,
            Err(error) => return Ok(none(frame, error.to_string())),
        };
        let allowed = match opaque(frame, store, allowed) {
            Ok(allowed) => allowed,
            Err(error) => return Ok(none(frame, error.to_string())),
        };
        let features = extractor.extract_from_image(&image, allowed.as_deref())?;
        Ok(coloured(features, &image))
    }

    /// Extracts features of simulated tilted views of a frame's image, at their positions in the image itself.
    ///
    /// The image is first shrunk so that its longer side is at most `max_side` pixels. Returns nothing if
    /// it cannot be read.
    ///
    /// # Errors
    /// As [`Self::of_frames`].
    pub fn tilted(
        &self,
        number: usize,
        tilts: &[Tilt],
        max_side: usize,
        progress: &Progress,
    ) -> Result<Vec<ImageFeatures>, SfmError> {
        let Self {
            frames,
            store,
            extractor,
            allowed,
            ..
        } = *self;
        let (frame, allowed) = (&frames[number], allowed(number));
        let Ok(image) = store.image(frame) else {
            return Ok(Vec::new());
        };
        let Ok(allowed) = opaque(frame, store, allowed.as_deref()) else {
            return Ok(Vec::new());
        };
        let (grey, size) = (image.luma(), [image.width as usize, image.height as usize]);
        let original = Original {
            grey: &grey,
            size,
            allowed: allowed.as_deref(),
        };
        let under = |&tilt: &Tilt| {
            progress.check()?;
            let found = tilted_features(extractor, original, tilt, max_side)?;
            Ok(coloured(found, &image))
        };
        let views = tilts.iter().map(under).collect();
        extractor.free_buffers();
        views
    }
}

/// Removes transparent pixels, which show nothing of the scene, from the allowed ones.
fn opaque<'a>(
    frame: &Frame,
    store: &FrameStore,
    allowed: Option<&'a [bool]>,
) -> Result<Option<Cow<'a, [bool]>>, FrameError> {
    Ok(match (store.opaque_pixels(frame)?, allowed) {
        (None, allowed) => allowed.map(Cow::Borrowed),
        (Some(opaque), None) => Some(Cow::Owned(opaque)),
        (Some(mut opaque), Some(allowed)) => {
            opaque
                .iter_mut()
                .zip(allowed)
                .for_each(|(opaque, allowed)| *opaque &= allowed);
            Some(Cow::Owned(opaque))
        }
    })
}

fn coloured(features: Features, image: &Image) -> ImageFeatures {
    let colors = features
        .keypoints
        .iter()
        .map(|&at_px| color_at(image, at_px))
        .collect();
    ImageFeatures {
        features,
        colors,
        unreadable: None,
        kept: None,
    }
}

fn changed(frame: &Frame) -> FrameError {
    let (ImageSource::File { path, .. } | ImageSource::Video { path, .. }) = &frame.image;
    FrameError::Invalid {
        path: path.clone(),
        what: "changed while cameras were computed; reconstruct again".into(),
    }
}

fn none(frame: &Frame, why: String) -> ImageFeatures {
    let features = Features {
        width: frame.width,
        height: frame.height,
        keypoints: Vec::new(),
        scales_px: Vec::new(),
        orientations: Vec::new(),
        scores: Vec::new(),
        descriptors: Descriptors::Bytes {
            dim: 1,
            values: Vec::new(),
        },
    };
    ImageFeatures {
        features,
        colors: Vec::new(),
        unreadable: Some(why),
        kept: None,
    }
}

fn color_at(image: &Image, at_px: DVec2) -> [u8; 3] {
    let x = (at_px.x.max(0.0) as u32).min(image.width - 1);
    let y = (at_px.y.max(0.0) as u32).min(image.height - 1);
    image.at(x, y)
}

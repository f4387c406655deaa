use std::borrow::Cow;

use glam::DVec2;

use super::asift::{Tilt, tilted_features};
use super::{Descriptors, FeatureExtractor, Features, SfmError};
use ostra_core::job::Progress;
use ostra_frames::{Frame, FrameError, FrameStore, Image};

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
    /// Pixels where features may lie.
    pub allowed: AllowedPixels<'a>,
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
        for (done, &number) in chosen.iter().enumerate() {
            progress.step(done, chosen.len())?;
            let next: Vec<Frame> = chosen[done + 1..]
                .iter()
                .take(AHEAD)
                .map(|&next| self.frames[next].clone())
                .collect();
            self.store.prefetch(&next);
            all.push(self.of_frame(number)?);
        }
        Ok(all)
    }

    /// Extracts features of one frame's image; none if it cannot be read.
    ///
    /// # Errors
    /// As [`Self::of_frames`].
    pub fn of_frame(&self, number: usize) -> Result<ImageFeatures, SfmError> {
        let Self {
            frames,
            store,
            extractor,
            allowed,
        } = *self;
        let (frame, allowed) = (&frames[number], allowed(number));
        let image = match store.image(frame) {
            Ok(image) => image,
            Err(error) => return Ok(none(frame, error.to_string())),
        };
        let allowed = match opaque(frame, store, allowed.as_deref()) {
            Ok(allowed) => allowed,
            Err(error) => return Ok(none(frame, error.to_string())),
        };
        let features = extractor.extract(
            &image.luma(),
            image.width as usize,
            image.height as usize,
            allowed.as_deref(),
        )?;
        Ok(coloured(features, &image))
    }

    /// Extracts features of simulated tilted views of a frame's image, at their positions in the image itself.
    ///
    /// Returns nothing if the image cannot be read.
    ///
    /// # Errors
    /// As [`Self::of_frames`].
    pub fn tilted(
        &self,
        number: usize,
        progress: &Progress,
    ) -> Result<Vec<ImageFeatures>, SfmError> {
        let Self {
            frames,
            store,
            extractor,
            allowed,
        } = *self;
        let (frame, allowed) = (&frames[number], allowed(number));
        let Ok(image) = store.image(frame) else {
            return Ok(Vec::new());
        };
        let Ok(allowed) = opaque(frame, store, allowed.as_deref()) else {
            return Ok(Vec::new());
        };
        let (grey, size) = (image.luma(), [image.width as usize, image.height as usize]);
        let under = |tilt: Tilt| {
            progress.check()?;
            Ok(coloured(
                tilted_features(extractor, &grey, size, allowed.as_deref(), tilt)?,
                &image,
            ))
        };
        Tilt::all().into_iter().map(under).collect()
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
    }
}

fn none(frame: &Frame, why: String) -> ImageFeatures {
    let features = Features {
        width: frame.width,
        height: frame.height,
        keypoints: Vec::new(),
        scales_px: Vec::new(),
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
    }
}

fn color_at(image: &Image, at_px: DVec2) -> [u8; 3] {
    let x = (at_px.x.max(0.0) as u32).min(image.width - 1);
    let y = (at_px.y.max(0.0) as u32).min(image.height - 1);
    image.at(x, y)
}

use std::borrow::Cow;

use glam::DVec2;

use super::tilted::{Tilt, tilted_features};
use super::{Descriptors, FeatureExtractor, Features, SfmError};
use ostra_core::job::Progress;
use ostra_frames::{Frame, FrameError, FrameStore, Image};

/// Pictures that are decoded while features of another are looked for.
const AHEAD: usize = 2;

/// What a picture gives for structure from motion.
#[derive(Debug, Clone)]
pub struct PictureFeatures {
    /// Its features.
    pub features: Features,
    /// The picture's colour at each keypoint, sRGB.
    pub colors: Vec<[u8; 3]>,
    /// Why there are none, where the picture cannot be read.
    pub unreadable: Option<String>,
}

/// Where features may lie in the frame of this number: `width · height` pixels row by row; `None` = everywhere.
pub type AllowedPixels<'a> = &'a dyn Fn(usize) -> Option<Vec<bool>>;

/// Features of the chosen frames, in their order. A picture that cannot be read has none.
///
/// # Errors
/// [`SfmError::Feature`] where the extractor fails, [`SfmError::Stopped`].
pub fn extract(
    frames: &[Frame],
    chosen: &[usize],
    store: &FrameStore,
    extractor: &dyn FeatureExtractor,
    allowed: AllowedPixels<'_>,
    progress: &Progress,
) -> Result<Vec<PictureFeatures>, SfmError> {
    let mut all = Vec::with_capacity(chosen.len());
    for (done, &number) in chosen.iter().enumerate() {
        progress.step(done, chosen.len())?;
        let next: Vec<Frame> = chosen[done + 1..]
            .iter()
            .take(AHEAD)
            .map(|&next| frames[next].clone())
            .collect();
        store.prefetch(&next);
        all.push(of_picture(
            &frames[number],
            store,
            extractor,
            allowed(number).as_deref(),
        )?);
    }
    Ok(all)
}

/// Features of one frame's picture; none where that cannot be read.
///
/// # Errors
/// As [`extract`].
pub fn of_picture(
    frame: &Frame,
    store: &FrameStore,
    extractor: &dyn FeatureExtractor,
    allowed: Option<&[bool]>,
) -> Result<PictureFeatures, SfmError> {
    let image = match store.image(frame) {
        Ok(image) => image,
        Err(error) => return Ok(none(frame, error.to_string())),
    };
    let allowed = match opaque(frame, store, allowed) {
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

/// Features of one frame's picture as it looks under many tilts, at their places in the picture; nothing where that
/// cannot be read.
///
/// # Errors
/// As [`extract`].
pub fn tilted_picture(
    frame: &Frame,
    store: &FrameStore,
    extractor: &dyn FeatureExtractor,
    allowed: Option<&[bool]>,
    progress: &Progress,
) -> Result<Vec<PictureFeatures>, SfmError> {
    let Ok(image) = store.image(frame) else {
        return Ok(Vec::new());
    };
    let Ok(allowed) = opaque(frame, store, allowed) else {
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

/// The allowed pixels without transparent ones, which show nothing of the scene.
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

fn coloured(features: Features, image: &Image) -> PictureFeatures {
    let colors = features
        .keypoints
        .iter()
        .map(|&at_px| color_at(image, at_px))
        .collect();
    PictureFeatures {
        features,
        colors,
        unreadable: None,
    }
}

fn none(frame: &Frame, why: String) -> PictureFeatures {
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
    PictureFeatures {
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

//! Access to frames for fusion, and the footprint of their pixels.

use std::sync::Arc;

use glam::DVec3;

use crate::SceneError;
use ostra_core::statistics::upper_median;
use ostra_frames::{DepthMap, Frame, FrameError, FrameStore, Image};
use ostra_masks::{LabelId, LabelMask};

/// Source of frames for fusion.
///
/// This is a project ([`ProjectViews`]), or depths that a reconstruction holds in memory.
pub trait Views: Sync {
    /// Returns all frames, by number, with name, size and camera.
    ///
    /// Their depth sources are ignored.
    fn frames(&self) -> &[Frame];

    /// Returns whether frame `index` has depth.
    fn has_depth(&self, index: usize) -> bool;

    /// Returns the image of frame `index`.
    ///
    /// # Errors
    ///
    /// Returns [`SceneError`] if it cannot be read.
    fn image(&self, index: usize) -> Result<Arc<Image>, SceneError>;

    /// Returns the depth map of frame `index`, aligned with its image, or `None` if it has none.
    ///
    /// # Errors
    ///
    /// Returns [`SceneError`] if it cannot be read.
    fn depth(&self, index: usize) -> Result<Option<Arc<DepthMap>>, SceneError>;

    /// Returns the mask of frame `index`, aligned with its image, or `None` if it has none.
    fn mask(&self, index: usize) -> Option<Arc<LabelMask>>;

    /// Returns why frame `index` cannot be read, if it cannot.
    ///
    /// This is the error of a job that could not read any frame.
    fn fault(&self, index: usize) -> Option<SceneError> {
        self.image(index).err().or_else(|| self.depth(index).err())
    }
}

/// The frames, images, depth maps and masks of a project.
#[derive(Clone, Copy)]
pub struct ProjectViews<'a> {
    /// All frames, by number.
    pub frames: &'a [Frame],
    /// The store that loads images and depth maps.
    pub store: &'a FrameStore,
    /// Returns the mask of a frame, if it has one.
    pub masks: &'a (dyn Fn(usize) -> Option<Arc<LabelMask>> + Sync),
}

impl Views for ProjectViews<'_> {
    fn frames(&self) -> &[Frame] {
        self.frames
    }

    fn has_depth(&self, index: usize) -> bool {
        self.frames[index].depth.is_some()
    }

    fn image(&self, index: usize) -> Result<Arc<Image>, SceneError> {
        Ok(self.store.image(&self.frames[index])?)
    }

    /// An unreadable depth map counts as missing; fusion names its frame in a warning.
    fn depth(&self, index: usize) -> Result<Option<Arc<DepthMap>>, SceneError> {
        Ok(readable(
            self.store
                .depth(&self.frames[index])
                .map_err(SceneError::from),
        )?
        .flatten())
    }

    fn mask(&self, index: usize) -> Option<Arc<LabelMask>> {
        (self.masks)(index)
    }

    fn fault(&self, index: usize) -> Option<SceneError> {
        let frame = &self.frames[index];
        Some(
            self.store
                .image(frame)
                .err()
                .or_else(|| self.store.depth(frame).err())?
                .into(),
        )
    }
}

/// Returns an image or depth, or `None` if its file cannot be read.
///
/// One damaged file among many should not end a job. The job names the file instead.
///
/// # Errors
///
/// Returns all other errors, including [`SceneError::Stopped`].
pub fn readable<T>(read: Result<T, SceneError>) -> Result<Option<T>, SceneError> {
    match read {
        Err(SceneError::Frame(FrameError::Stopped(stopped))) => Err(stopped.into()),
        Err(SceneError::Frame(_)) => Ok(None),
        read => read.map(Some),
    }
}

/// Checks that pixels have the size of their frame.
///
/// Pixels of another size would vote for the wrong points.
pub(super) fn check_size(
    frame: &Frame,
    what: &str,
    width: u32,
    height: u32,
) -> Result<(), SceneError> {
    if (width, height) == (frame.width, frame.height) {
        return Ok(());
    }
    Err(SceneError::Request(format!(
        "frame '{}': its {what} is {width}x{height} but its image is {}x{}; give a {what} of the image's size",
        frame.name, frame.width, frame.height
    )))
}

/// Returns the minimum coordinates over all camera centres.
///
/// This is near the scene wherever it lies, and does not depend on the order of frames.
pub(crate) fn nearest_corner(views: &dyn Views, usable: &[usize]) -> DVec3 {
    let centres = usable
        .iter()
        .filter_map(|&index| Some(views.frames()[index].posed_camera()?.1.centre()));
    centres.reduce(DVec3::min).unwrap_or_default()
}

/// Maximum number of sampled frames.
const FRAMES: usize = 8;
/// Sampling step between the pixels of a frame.
const PIXEL_STEP: usize = 37;
/// Minimum number of labelled samples for using only labelled pixels.
const ENOUGH_LABELLED: usize = 20;

/// Returns the width of one pixel at the median depth, in world units, rounded to two digits.
///
/// This is the finest detail that most pixels can show. If masks have labels, only labelled pixels
/// count, because a plant is closer than the wall behind it. Returns `None` if no frame has a depth
/// above 0.
///
/// # Errors
///
/// Returns the error of a depth map that cannot be read.
pub fn pixel_footprint(views: &dyn Views, usable: &[usize]) -> Result<Option<f64>, SceneError> {
    let step = usable.len().div_ceil(FRAMES).max(1);
    let (mut labelled, mut all) = (Vec::new(), Vec::new());
    for &index in usable.iter().step_by(step) {
        let (Some((camera, _)), Some(depth)) =
            (views.frames()[index].posed_camera(), views.depth(index)?)
        else {
            continue;
        };
        let focal = camera.focal_px.max_element() as f32;
        let mask = views.mask(index);
        let has_label = |pixel: usize| {
            mask.as_ref()
                .and_then(|mask| mask.ids.get(pixel))
                .is_some_and(|&id| id != LabelId::NONE)
        };
        for (pixel, &depth) in depth.depths.iter().enumerate().step_by(PIXEL_STEP) {
            if depth > 0.0 && depth.is_finite() {
                all.push(depth / focal);
                labelled.extend(has_label(pixel).then_some(depth / focal));
            }
        }
    }
    let enough = labelled.len() >= ENOUGH_LABELLED;
    let footprints = if enough { &mut labelled } else { &mut all };
    Ok(upper_median(footprints).map(f64::from).map(two_digits))
}

pub(super) fn two_digits(value: f64) -> f64 {
    let unit = 10f64.powi(value.log10().floor() as i32 - 1);
    let steps = (value / unit).round();
    // Dividing by whole powers of ten gives the shortest decimal: 0.0034, not
    // 0.0034000000000000002.
    if unit < 1.0 {
        steps / (1.0 / unit).round()
    } else {
        steps * unit
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_to_two_digits_gives_short_decimals() {
        assert_eq!(two_digits(0.003_412), 0.0034);
        assert_eq!(two_digits(0.099_9), 0.1);
        assert_eq!(two_digits(123.0), 120.0);
        assert_eq!(two_digits(1.26), 1.3);
    }
}
